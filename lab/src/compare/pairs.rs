//! Runs of two sides, paired by input and seed.

use crate::Failure;
use crate::results::{Run, read, runs};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Key of a pair: input, variant (if relevant), frames at most, seed.
type Common = (String, String, Option<u64>, u64);

/// Runs selected by `FILE` or `FILE#WHICH`, see [`super::Arguments`].
pub(crate) fn side(named: &str) -> Result<Vec<Run>, Failure> {
    let (file, which) = match named.rsplit_once('#') {
        Some((file, which)) => (file, Some(which)),
        None => (named, None),
    };
    let all = runs(&read(Path::new(file))?);
    let is = |r: &Run| {
        which.is_none_or(|w| {
            r.key.variant == w || r.commit.starts_with(w) || r.key.program.starts_with(w)
        })
    };
    let chosen: Vec<Run> = all.iter().filter(|r| is(r)).cloned().collect();
    if chosen.is_empty() {
        let held: BTreeSet<String> = all
            .iter()
            .map(|r| format!("{} of {} ({})", r.key.variant, r.commit, r.key.program))
            .collect();
        return Err(format!(
            "{named}: expected runs of a variant, commit or program, found none; the file holds {held:?}"
        )
        .into());
    }
    Ok(chosen)
}

#[derive(Clone, Debug)]
pub(crate) struct Group {
    pub(crate) name: String,
    pub(crate) pairs: Vec<(Run, Run)>,
}

impl Group {
    /// Number of independent pairs when inputs are judged together. A recording or a scene with a fixed seed counts once, since its seeds
    /// share the images.
    pub(crate) fn independent(&self) -> usize {
        let own = |(a, _): &(Run, Run)| {
            let input = &a.key.input;
            input.starts_with("sim:") && !input.contains('@')
        };
        if self.pairs.iter().all(own) {
            self.pairs.len()
        } else {
            1
        }
    }
}

/// All pairs by input, and messages for runs without a partner.
#[derive(Debug)]
pub(crate) struct Pairs {
    pub(crate) groups: Vec<Group>,
    pub(crate) alone: Vec<String>,
}

/// Ignores variant names if each side has only one.
pub(crate) fn pair(a: Vec<Run>, b: Vec<Run>) -> Result<Pairs, Failure> {
    let variants =
        |runs: &[Run]| -> BTreeSet<String> { runs.iter().map(|r| r.key.variant.clone()).collect() };
    let several = variants(&a).len() > 1 || variants(&b).len() > 1;
    let (a, mut b) = (by_common("A", a, several)?, by_common("B", b, several)?);
    let mut groups: Vec<Group> = Vec::new();
    let mut alone = Vec::new();
    for (common, run) in a {
        let Some(partner) = b.remove(&common) else {
            alone.push(format!("only in A: {}", named(&common)));
            continue;
        };
        let name = group(&common);
        match groups.last_mut().filter(|g| g.name == name) {
            Some(group) => group.pairs.push((run, partner)),
            None => groups.push(Group {
                name,
                pairs: vec![(run, partner)],
            }),
        }
    }
    alone.extend(
        b.keys()
            .map(|common| format!("only in B: {}", named(common))),
    );
    Ok(Pairs { groups, alone })
}

fn by_common(side: &str, runs: Vec<Run>, several: bool) -> Result<BTreeMap<Common, Run>, Failure> {
    let mut all = BTreeMap::new();
    for run in runs {
        let key = &run.key;
        let variant = if several {
            key.variant.clone()
        } else {
            String::new()
        };
        let common = (key.input.clone(), variant, key.frames_at_most, key.seed);
        if let Some(other) = all.insert(common.clone(), run) {
            return Err(format!(
                "{side}: expected one run of {}, found several (programs {} and others); say which by FILE#VARIANT or FILE#COMMIT",
                named(&common),
                other.key.program
            )
            .into());
        }
    }
    Ok(all)
}

fn group((input, variant, frames, _): &Common) -> String {
    let mut name = input.clone();
    if !variant.is_empty() {
        name += &format!(", {variant}");
    }
    if let Some(n) = frames {
        name += &format!(", {n} frames");
    }
    name
}

fn named(common: &Common) -> String {
    format!("{}, seed {}", group(common), common.3)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::Line;
    use crate::results::tests::run;

    #[test]
    fn runs_are_paired_by_input_and_seed() {
        let a = vec![
            run("x", "old", 0, 1.0),
            run("x", "old", 1, 1.0),
            run("y", "old", 0, 1.0),
        ];
        let b = vec![
            run("x", "new", 1, 2.0),
            run("x", "new", 0, 3.0),
            run("z", "new", 0, 1.0),
        ];
        let pairs = pair(a, b).unwrap();
        assert_eq!(
            pairs.alone,
            ["only in A: y, seed 0", "only in B: z, seed 0"]
        );
        assert_eq!(pairs.groups.len(), 1);
        let seeds: Vec<_> = pairs.groups[0]
            .pairs
            .iter()
            .map(|(a, b)| (a.key.seed, b.key.seed))
            .collect();
        assert_eq!(seeds, [(0, 0), (1, 1)]);
    }

    #[test]
    fn variants_are_paired_by_name() {
        let both = |ate| vec![run("x", "on", 0, ate), run("x", "off", 0, ate)];
        let pairs = pair(both(1.0), both(2.0)).unwrap();
        let names: Vec<&str> = pairs.groups.iter().map(|g| g.name.as_str()).collect();
        assert_eq!(names, ["x, off", "x, on"]);
        let mut other = run("x", "on", 0, 1.0);
        other.key.program = "q".to_owned();
        let e = pair(vec![run("x", "on", 0, 1.0), other], both(1.0)).unwrap_err();
        assert!(e.to_string().contains("FILE#COMMIT"), "{e}");
    }

    #[test]
    fn side_is_selected_by_variant_commit_or_program() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("runs.jsonl");
        let mut second = run("x", "off", 0, 2.0);
        (second.commit, second.key.program) = ("abc123".to_owned(), "feed".to_owned());
        let lines = [run("x", "on", 0, 1.0), second];
        let text: String = lines
            .map(|r| serde_json::to_string(&Line::Run(Box::new(r))).unwrap() + "\n")
            .concat();
        std::fs::write(&file, text).unwrap();
        let named = |which: &str| side(&format!("{}{which}", file.display()));
        assert_eq!(named("").unwrap().len(), 2);
        for which in ["#off", "#abc", "#feed"] {
            let found = named(which).unwrap();
            assert_eq!((found.len(), found[0].key.variant.as_str()), (1, "off"));
        }
        let e = named("#no").unwrap_err().to_string();
        assert!(e.contains("on of c (p)"), "{e}");
    }
}
