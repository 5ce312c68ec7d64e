//! `lab constants`: the real table, and a stale one.

use crate::lab;

/// After a change of a constant or its comment, renew the table with `lab constants`.
#[test]
fn constants_table_matches_the_sources() {
    let (code, out, said) = lab(&["constants", "--check"]);
    assert_eq!(code, Some(0), "{out}{said}");
}

#[test]
fn stale_constants_table_is_found_and_rewritten() {
    let dir = tempfile::tempdir().unwrap();
    let write = |path: &str, text: &str| {
        let path = dir.path().join(path);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    };
    for folder in ["estimation/src", "features/src", "detection/src/objects"] {
        write(&format!("crates/{folder}/lib.rs"), "");
    }
    write(
        "crates/slam/src/a/far.rs",
        "/// How far, m.\nconst FAR: f64 = 4.0;\n",
    );
    write("docs/reference/constants.md", "stale");
    let root = dir.path().to_str().unwrap();
    let check = || lab(&["constants", "--check", "--root", root]).0;
    assert_eq!(check(), Some(1));
    assert_eq!(lab(&["constants", "--root", root]).0, Some(0));
    assert_eq!(check(), Some(0));
    let row = r#"{"kind":"row","cells":["crates/slam/src/a/far.rs","FAR","1 to 2 mm"]}"#;
    write("lab/results/constants.jsonl", &format!("{row}\n"));
    assert_eq!(check(), Some(1));
    assert_eq!(lab(&["constants", "--root", root]).0, Some(0));
    let text = std::fs::read_to_string(dir.path().join("docs/reference/constants.md")).unwrap();
    let line = "| `FAR` | `4.0` | m | How far, m. |  | 1 to 2 mm |";
    assert!(text.contains(line), "{text}");
    assert!(
        text.contains("- `crates/slam/src/a/far.rs`: `FAR`"),
        "{text}"
    );
}
