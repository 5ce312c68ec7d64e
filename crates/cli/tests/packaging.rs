//! Packaging: completions that a shell can use, and manual pages that a checker accepts.

use crate::common::{check, stdout, stillpoint};
use std::process::Command;

/// Whether a program is installed; without it the test is counted as skipped.
fn there_is(program: &str) -> bool {
    let started = Command::new(program).arg("--version").output().is_ok();
    if !started {
        stillpoint_testdata::skipped(&format!("there is no {program}"));
    }
    started
}

fn offered(script: &str, words: &[&str]) -> Vec<String> {
    let ask = format!(
        "{script}\nCOMP_WORDS=({}); COMP_CWORD={}; _stillpoint stillpoint '{}' '{}'; printf '%s\\n' \"${{COMPREPLY[@]}}\"",
        words.join(" "),
        words.len() - 1,
        words[words.len() - 1],
        words[words.len() - 2],
    );
    let output = Command::new("bash").args(["-c", &ask]).output().unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(errors.is_empty(), "{errors}");
    let text = String::from_utf8(output.stdout).unwrap();
    text.lines().map(str::to_owned).collect()
}

#[test]
fn bash_completes_commands_and_options() {
    let output = stillpoint(["completions", "bash"]);
    check(&output, 0, &[]);
    let script = stdout(&output);
    if !there_is("bash") {
        return;
    }
    assert_eq!(offered(&script, &["stillpoint", "rec"]), ["recording"]);
    assert_eq!(offered(&script, &["stillpoint", "map", "ex"]), ["export"]);
    let options = offered(&script, &["stillpoint", "run", "--save"]);
    assert_eq!(options, ["--save-map"]);
    assert_eq!(offered(&script, &["stillpoint", "nonsense"]), [""]);
}

#[test]
fn manual_pages_pass_their_checker() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("share/man1");
    let output = stillpoint(["man", out.to_str().unwrap()]);
    check(&output, 0, &[]);
    let pages = std::fs::read_dir(&out).unwrap();
    let pages: Vec<_> = pages.map(|entry| entry.unwrap().path()).collect();
    let said = stdout(&output);
    assert!(
        said.starts_with(&format!("{} manual pages in", pages.len())),
        "{said}"
    );
    // Overwrites the existing pages.
    check(&stillpoint(["-q", "man", out.to_str().unwrap()]), 0, &[]);
    if Command::new("mandoc").arg("-h").output().is_err() {
        return stillpoint_testdata::skipped("there is no mandoc");
    }
    let output = Command::new("mandoc").arg("-Tlint").args(&pages).output();
    let text = String::from_utf8(output.unwrap().stdout).unwrap();
    assert_eq!(text, "");
    // Control: the checker rejects a faulty page.
    std::fs::write(out.join("bad.1"), ".TH bad 1\n.SH NAME\nbad  \n").unwrap();
    let bad = Command::new("mandoc")
        .arg("-Tlint")
        .arg(out.join("bad.1"))
        .output();
    assert!(!bad.unwrap().stdout.is_empty());
}

#[test]
fn unwritable_man_path_or_unknown_shell_is_reported() {
    let file = tempfile::NamedTempFile::new().unwrap();
    let path = file.path().to_str().unwrap();
    check(&stillpoint(["man", path]), 2, &[path, "expected a folder"]);
    check(&stillpoint(["completions", "nosh"]), 2, &["nosh", "elvish"]);
}

/// Every linked package is listed with its licence, and no other.
#[test]
fn notices_match_the_linked_packages() {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");
    let read = |name: &str| std::fs::read_to_string(format!("{root}/{name}")).unwrap();
    let (notices, lock) = (read("NOTICES.md"), read("Cargo.lock"));
    let output = Command::new(env!("CARGO"))
        .current_dir(root)
        .args([
            "tree",
            "-p",
            "stillpoint-cli",
            "-e",
            "normal",
            "--prefix",
            "none",
        ])
        .args(["--locked", "--offline", "-f", "{p}"])
        .output()
        .unwrap();
    check(&output, 0, &[]);
    let text = stdout(&output);
    let mut linked = 0;
    for line in text.lines().filter(|l| !l.starts_with("stillpoint")) {
        let mut words = line.split(' ');
        let (name, version) = (words.next().unwrap(), words.next().unwrap());
        let entry = format!("- {name} {}", version.trim_start_matches('v'));
        assert!(
            notices
                .lines()
                .any(|l| l == entry || l.starts_with(&format!("{entry} "))),
            "NOTICES.md lacks {name} {version}: run tools/notices"
        );
        linked += 1;
    }
    assert!(linked > 100, "{text}");
    for line in notices.lines().filter_map(|l| l.strip_prefix("- ")) {
        let mut words = line.split(' ');
        let (name, version) = (words.next().unwrap(), words.next().unwrap_or(""));
        let entry = format!("name = \"{name}\"\nversion = \"{version}\"\n");
        assert!(
            lock.contains(&entry),
            "NOTICES.md has {name} {version}, which is not linked: run tools/notices"
        );
    }
    assert!(notices.contains("SQLite") && notices.contains("Roboto"));
}
