//! Limits on archives: one of some kilobytes can unpack to any size.

/// Maximum bytes of an archive of unknown size: the largest known sequence has some 6 GB.
pub(crate) const LARGEST: u64 = 1 << 35;
/// Maximum number of files and folders: an hour of colour and depth at 30 Hz.
pub(crate) const MOST_ENTRIES: u64 = 250_000;
/// Bytes that may always be unpacked: lists and tables of measurements.
const FREE_BYTES: u64 = 1 << 28;
/// Additional bytes per packed byte: PNG and JPEG are packed already, tables unpack to five.
const BYTES_PER_PACKED: u64 = 10;
/// Maximum bytes of a tar between two files: headers, long names, and the blanks at the end.
pub(crate) const BETWEEN_FILES: u64 = 1 << 20;
/// Maximum bytes of a path within the archive; those of data sets have some 60.
const LONGEST_PATH: usize = 512;

#[derive(Debug)]
pub(crate) struct Budget {
    bytes: u64,
    entries: u64,
}

impl Budget {
    /// For an archive of this many bytes.
    pub(crate) fn of(packed: u64) -> Self {
        Self {
            bytes: FREE_BYTES.saturating_add(packed.saturating_mul(BYTES_PER_PACKED)),
            entries: MOST_ENTRIES,
        }
    }

    /// Subtracts a file or folder; an error names the exceeded limit.
    pub(crate) fn take(&mut self, bytes: u64) -> Result<(), String> {
        let Some(entries) = self.entries.checked_sub(1) else {
            return Err(format!("more than {MOST_ENTRIES} files and folders"));
        };
        let Some(left) = self.bytes.checked_sub(bytes) else {
            return Err(format!(
                "one that unpacks to more than {BYTES_PER_PACKED} times its size"
            ));
        };
        (self.entries, self.bytes) = (entries, left);
        Ok(())
    }
}

/// The folders and the name of a path in an archive, in a form that all systems interpret alike.
pub(crate) fn parts(path: &str) -> Result<Vec<&str>, String> {
    let refused = |why: &str| Err(format!("a path {why} ({:.80})", path.escape_debug()));
    if path.len() > LONGEST_PATH {
        return refused("that is too long");
    }
    if path.starts_with('/') || path.contains([':', '\\']) {
        return refused("that names a place of its own");
    }
    if path.contains(char::is_control) {
        return refused("with control characters");
    }
    let parts: Vec<&str> = path
        .split('/')
        .filter(|p| !p.is_empty() && *p != ".")
        .collect();
    if parts.contains(&"..") {
        return refused("that leads out of its folder");
    }
    Ok(parts)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn archive_paths_stay_inside() {
        assert_eq!(parts("./a/b/").unwrap(), ["a", "b"]);
        assert_eq!(parts("a//b..png").unwrap(), ["a", "b..png"]);
        for bad in [
            "../a",
            "a/../../b",
            "/etc/passwd",
            "a/..",
            "C:\\a",
            "a:b",
            "..\\a",
            "a\0b",
            "a\nb",
        ] {
            assert!(parts(bad).is_err(), "{bad:?}");
        }
        assert!(parts(&"a/".repeat(300)).is_err());
    }

    #[test]
    fn unpacking_budget_is_consumed() {
        let mut budget = Budget::of(10);
        assert!(budget.take(FREE_BYTES + 101).is_err());
        assert!(budget.take(FREE_BYTES + 100).is_ok());
        assert!(budget.take(1).unwrap_err().contains("10 times"));
        for _ in 1..MOST_ENTRIES {
            budget.take(0).unwrap();
        }
        assert!(budget.take(0).unwrap_err().contains("250000 files"));
    }
}
