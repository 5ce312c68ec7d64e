//! `lab document`: the real documents, and one that differs.

use crate::lab;

/// After a change of a result file, renew the documents with `lab document`.
#[test]
fn documents_match_the_result_files() {
    let (code, out, said) = lab(&["document", "--check"]);
    assert_eq!(code, Some(0), "{out}{said}");
    assert!(!said.contains("no document shows it"), "{said}");
}

#[test]
fn differing_document_is_found_and_rewritten() {
    let dir = tempfile::tempdir().unwrap();
    let (docs, results) = (dir.path().join("docs"), dir.path().join("lab/results"));
    std::fs::create_dir_all(&docs).unwrap();
    std::fs::create_dir_all(&results).unwrap();
    let text = "# Speed\n<!-- lab: speed -->\n<!-- /lab -->\nThe end.\n";
    std::fs::write(docs.join("speed.md"), text).unwrap();
    std::fs::write(dir.path().join("README.md"), "none\n").unwrap();
    let lines = r#"{"kind":"made","command":"lab speed 3","commit":"abc","machine":"M, 2 cores","seeds":"3 seeds"}
{"kind":"table","columns":["what","kind","ms"],"words":[1]}
{"kind":"row","cells":["flow","x","1.5"]}
"#;
    std::fs::write(results.join("speed.jsonl"), lines).unwrap();
    let root = dir.path().to_str().unwrap();
    let check = || lab(&["document", "--check", "--root", root]);
    let (code, out, said) = check();
    assert_eq!(code, Some(1), "{out}{said}");
    assert!(out.contains("docs/speed.md: differs"), "{out}");
    let (code, out, said) = lab(&["document", "--root", root]);
    assert_eq!(code, Some(0), "{out}{said}");
    let written = std::fs::read_to_string(docs.join("speed.md")).unwrap();
    let expected = "# Speed\n<!-- lab: speed -->\nMade by `lab speed 3`, commit abc; M, 2 cores; 3 seeds.\n\n\
        | what | kind |  ms |\n|------|------|----:|\n| flow | x    | 1.5 |\n\n<!-- /lab -->\nThe end.\n";
    assert_eq!(written, expected);
    assert_eq!(check().0, Some(0));
    // A figure changed by hand.
    std::fs::write(docs.join("speed.md"), written.replace("1.5", "1.4")).unwrap();
    assert_eq!(check().0, Some(1));
    // A result file that no document shows, and a region without a file.
    std::fs::write(results.join("other.jsonl"), lines).unwrap();
    assert!(
        check()
            .2
            .contains("lab/results/other.jsonl: no document shows it")
    );
    std::fs::remove_file(results.join("speed.jsonl")).unwrap();
    let (code, _, said) = check();
    assert_eq!(code, Some(2), "{said}");
    assert!(
        said.contains("docs/speed.md: line 2: ") && said.contains("speed.jsonl"),
        "{said}"
    );
}
