//! Suggestions for mistyped names.

/// The name with the smallest edit distance to `path`; a missing section counts little.
pub(crate) fn nearest<'a>(path: &str, names: &[&'a str]) -> Vec<&'a str> {
    let last = |p: &str| p.rsplit('.').next().unwrap_or_default().to_owned();
    let edits = |name: &str| {
        let whole = distance(path, name);
        whole.min(distance(&last(path), &last(name)) + 1)
    };
    let least = names.iter().map(|name| edits(name)).min();
    let nearest = names.iter().filter(|name| Some(edits(name)) == least);
    nearest.copied().collect()
}

/// The name with the smallest edit distance, if that is at most `share` of its length.
pub(crate) fn near<'a>(text: &str, names: &[&'a str], share: f64) -> Option<&'a str> {
    let closest = names
        .iter()
        .copied()
        .min_by_key(|name| distance(text, name))?;
    let edits = distance(text, closest) as f64;
    (edits <= share * closest.chars().count() as f64).then_some(closest)
}

fn distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, y) in b.iter().enumerate() {
            let replaced = diagonal + usize::from(x != *y);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}
