//! What each configuration value means, for `config print`.
//!
//! The text is that of the fields' documentation in the source; a test compares the two and can renew the file.

/// One line per value: its path, a tab, its meaning.
const DOCS: &str = include_str!("config_docs.txt");

/// The meaning of a value or section, e.g. of `tracking.min_inliers`.
pub(crate) fn doc_of(path: &str) -> Option<&'static str> {
    DOCS.lines()
        .filter_map(|line| line.split_once('\t'))
        .find(|(p, _)| *p == path)
        .map(|(_, doc)| doc)
}
