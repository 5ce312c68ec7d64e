//! The documents: every link between them leads somewhere, and the book has all of them.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    root.canonicalize().unwrap()
}

/// All Markdown files below a folder.
fn markdown(folder: &Path) -> Vec<PathBuf> {
    let (mut open, mut found) = (vec![folder.to_owned()], Vec::new());
    while let Some(path) = open.pop() {
        if path.is_dir() {
            open.extend(fs::read_dir(&path).unwrap().map(|e| e.unwrap().path()));
        } else if path.extension().is_some_and(|e| e == "md") {
            found.push(path);
        }
    }
    found
}

/// The text without blocks of code, and with what is quoted as code left out.
fn prose(text: &str) -> String {
    let mut code = false;
    let mut prose = String::new();
    for line in text.lines() {
        if line.trim_start().starts_with("```") {
            code = !code;
        } else if !code {
            let parts = line.split('`').enumerate();
            let plain = parts.filter(|(i, _)| i % 2 == 0).map(|(_, part)| part);
            prose.extend(plain);
            prose.push('\n');
        }
    }
    prose
}

/// Where the links of a text lead.
fn links(text: &str) -> Vec<String> {
    let prose = prose(text);
    let after = prose.split("](").skip(1);
    let target = |part: &str| part.split([')', ' ']).next().unwrap_or_default().to_owned();
    after.map(target).collect()
}

/// The names by which headings are linked to, as GitHub and mdBook make them.
fn anchors(text: &str) -> BTreeSet<String> {
    let mut code = false;
    let mut seen: BTreeMap<String, usize> = BTreeMap::new();
    let mut anchors = BTreeSet::new();
    for line in text.lines() {
        code ^= line.starts_with("```");
        let heading = line.trim_start_matches('#');
        if code || heading.len() == line.len() || !heading.starts_with(' ') {
            continue;
        }
        let kept = |c: &char| c.is_alphanumeric() || " -_".contains(*c);
        let name: String = heading.trim().to_lowercase().chars().filter(kept).collect();
        let name = name.replace(' ', "-");
        let count = seen.entry(name.clone()).or_default();
        anchors.insert(if *count == 0 {
            name
        } else {
            format!("{name}-{count}")
        });
        *count += 1;
    }
    anchors
}

#[test]
fn every_link_leads_somewhere() {
    let (root, docs) = (root(), root().join("docs"));
    let mut files = markdown(&docs);
    for name in [
        "README.md",
        "ARCHITECTURE.md",
        "CONTRIBUTING.md",
        "CHANGELOG.md",
        "python/README.md",
    ] {
        files.push(root.join(name));
    }
    let mut followed = 0;
    for file in files {
        let text = fs::read_to_string(&file).unwrap();
        for link in links(&text) {
            let shown = format!("{}: {link}", file.display());
            if link.starts_with("https://") {
                // Links to files of this project, which a page outside of the book is linked by.
                let inner = link.strip_prefix("https://github.com/stillpoint-slam/stillpoint/");
                let path = inner.and_then(|l| l.splitn(3, '/').nth(2));
                let there = path.is_none_or(|path| root.join(path).exists());
                assert!(there, "{shown}");
                continue;
            }
            let (path, anchor) = link.split_once('#').unwrap_or((&link, ""));
            let target = if path.is_empty() {
                file.clone()
            } else {
                file.parent().unwrap().join(path)
            };
            let target = target
                .canonicalize()
                .unwrap_or_else(|e| panic!("{shown}: {e}"));
            // The book has the documents alone.
            let inside = target.starts_with(&docs) || !file.starts_with(&docs);
            assert!(
                inside,
                "{shown} leads out of the book; link to the file on the project's page"
            );
            if !anchor.is_empty() {
                let known = anchors(&fs::read_to_string(&target).unwrap());
                assert!(known.contains(anchor), "{shown} is none of {known:?}");
            }
            followed += 1;
        }
    }
    assert!(followed > 100, "{followed} links");
}

#[test]
fn the_book_has_every_document_once() {
    let docs = root().join("docs");
    let summary = fs::read_to_string(docs.join("SUMMARY.md")).unwrap();
    let chapters = links(&summary);
    let named: BTreeSet<PathBuf> = chapters.iter().map(|link| docs.join(link)).collect();
    assert_eq!(named.len(), chapters.len(), "a chapter is named twice");
    let mut all: BTreeSet<PathBuf> = markdown(&docs).into_iter().collect();
    all.remove(&docs.join("SUMMARY.md"));
    let missing: Vec<_> = all.difference(&named).collect();
    assert!(missing.is_empty(), "not in docs/SUMMARY.md: {missing:?}");
    let unknown: Vec<_> = named.difference(&all).collect();
    assert!(
        unknown.is_empty(),
        "in docs/SUMMARY.md and no document: {unknown:?}"
    );
    let book = fs::read_to_string(root().join("book.toml")).unwrap();
    assert!(book.contains("src = \"docs\""));
}

/// Words of a page of the manual at most: what one reads before one goes on.
const LONGEST: usize = 600;

#[test]
fn pages_of_the_manual_begin_with_what_to_type_and_are_short() {
    let pages = markdown(&root().join("docs/manual"));
    assert!((1..=12).contains(&pages.len()), "{} pages", pages.len());
    for page in pages {
        let text = fs::read_to_string(&page).unwrap();
        let shown = page.display();
        let mut lines = text.lines();
        assert!(lines.next().unwrap().starts_with("# "), "{shown}");
        assert!(lines.next().unwrap().starts_with("```"), "{shown}");
        let words = text.split_whitespace().filter(|w| *w != "|").count();
        assert!(words <= LONGEST, "{shown}: {words} words");
    }
}

#[test]
fn links_and_headings_are_found() {
    let text = "# A b: `c`\n[x](a.md#b) `[no](no.md)`\n```\n[no](no.md)\n# no\n```\n## A b c\n";
    assert_eq!(links(text), ["a.md#b"]);
    let expected = ["a-b-c", "a-b-c-1"].map(str::to_owned);
    assert_eq!(anchors(text), BTreeSet::from(expected));
}
