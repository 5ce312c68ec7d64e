//! Valid model names; they become file names.

use super::error::CacheError;

/// Maximum length of a name, characters: with every suffix it stays far below the limits of file systems.
const LONGEST: usize = 64;

/// Endings with a meaning of their own in the cache, or copied from a file name by mistake.
const ENDINGS: [&str; 7] = [
    ".onnx", ".toml", ".part", ".record", ".sha256", ".lock", ".tmp",
];

/// Names of devices on Windows, with any extension.
const DEVICES: [&str; 4] = ["con", "prn", "aux", "nul"];

/// Checks a model name: ASCII letters, digits, `-`, `_` and `.`, beginning with a letter or digit, at most 64 characters. Separators and
/// `..` cannot occur, so a name never leaves the cache's folder.
///
/// # Errors
/// [`CacheError::Name`] with the problem.
pub fn check_name(name: &str) -> Result<(), CacheError> {
    let allowed = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    let lower = name.to_ascii_lowercase();
    let stem = lower.split('.').next().unwrap_or_default();
    let port = |prefix: &str| {
        stem.strip_prefix(prefix)
            .is_some_and(|n| n.len() == 1 && n.as_bytes()[0].is_ascii_digit())
    };
    let problem = if name.is_empty() {
        "an empty name".to_owned()
    } else if let Some(c) = name.chars().find(|&c| !allowed(c)) {
        format!("the character {c:?}")
    } else if name.len() > LONGEST {
        format!("{} characters", name.len())
    } else if !name.starts_with(|c: char| c.is_ascii_alphanumeric()) {
        "a name that begins otherwise".to_owned()
    } else if name.ends_with('.') || name.contains("..") {
        "dots that do not part letters".to_owned()
    } else if let Some(ending) = ENDINGS.iter().find(|e| lower.ends_with(*e)) {
        format!("the ending {ending}")
    } else if DEVICES.contains(&stem) || port("com") || port("lpt") {
        "the name of a device on Windows".to_owned()
    } else {
        return Ok(());
    };
    Err(CacheError::Name {
        name: name.chars().take(LONGEST).collect(),
        problem,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ordinary_model_names_are_accepted() {
        for name in ["yolox-nano", "a", "YOLOv7_tiny.2", "9", "console", "com10"] {
            assert!(check_name(name).is_ok(), "{name}");
        }
        assert!(check_name(&"n".repeat(64)).is_ok());
    }

    #[test]
    fn unsafe_model_names_are_refused() {
        for name in [
            "",
            ".",
            "..",
            "../x",
            "a/b",
            "a\\b",
            "/etc/passwd",
            "c:x",
            "a\0b",
            "a b",
            "a\nb",
            "ä",
            ".hidden",
            "-x",
            "a.",
            "a..b",
            "nul",
            "NUL.v2",
            "com1",
            "LPT9.x",
            "x.onnx",
            "x.TOML",
            "x.part",
            "x.record",
            "x.lock",
            "x.sha256",
            "~",
            "*",
            "\u{202e}x",
        ] {
            let e = check_name(name).unwrap_err();
            assert!(e.to_string().contains("expected a model's name"), "{e}");
        }
        assert!(check_name(&"n".repeat(65)).is_err());
        let long = check_name(&"/".repeat(100_000)).unwrap_err().to_string();
        assert!(long.len() < 400, "{}", long.len());
    }

    proptest::proptest! {
        /// A valid name is one ordinary path component, with every suffix.
        #[test]
        fn valid_names_stay_in_the_folder(name in "\\PC{0,12}|[a-z./\\\\:]{0,12}") {
            if check_name(&name).is_ok() {
                let path = std::path::Path::new("root").join(format!("{name}.onnx"));
                proptest::prop_assert_eq!(path.parent(), Some(std::path::Path::new("root")));
                proptest::prop_assert_eq!(path.components().count(), 2);
            }
        }
    }
}
