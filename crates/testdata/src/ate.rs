//! The table of errors that runs have: `ate.csv` beside this crate's `src`. A bound that a run must keep says what is good enough; this
//! says what it was, so that a change that makes a run a fifth worse is noticed, and one that makes it a fifth better is recorded.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::PathBuf;
use std::sync::Mutex;

/// How far a run may be from the table, as a share of what stands there.
const BAND: f64 = 0.2;
const HEAD: &str = "sequence,detector,preset,rmse_mm";

type Table = BTreeMap<String, f64>;

fn file() -> PathBuf {
    [env!("CARGO_MANIFEST_DIR"), "ate.csv"].iter().collect()
}

fn parse(text: &str) -> Table {
    let rows = text.lines().skip(1).map(|line| {
        let (key, value) = line.rsplit_once(',').expect("columns");
        (key.to_owned(), value.parse().expect("rmse_mm: a number"))
    });
    rows.collect()
}

fn print(table: &Table) -> String {
    let mut text = format!("{HEAD}\n");
    for (key, value) in table {
        writeln!(text, "{key},{value:.2}").expect("strings take everything");
    }
    text
}

/// What is wrong with an error, mm, beside what stands in the table.
fn complaint(expected: Option<f64>, found: f64) -> Option<String> {
    let Some(expected) = expected else {
        return Some(format!("found {found:.2} mm, and no row in the table"));
    };
    // A negated comparison, so that what is no number is far off.
    let near = (found - expected).abs() <= BAND * expected;
    (!near)
        .then(|| format!("expected an error within 20 % of {expected:.2} mm, found {found:.2} mm"))
}

/// Holds the error of a run (RMSE, mm: its ATE, or its drift where the camera stands still) against the table: the sequence, by a name without commas, the detector and the preset of the
/// static filter. With `STILLPOINT_BLESS` set it writes the row instead.
///
/// # Panics
/// When the error is more than 20 % off what stands in the table, to either side, or nothing stands there.
#[track_caller]
pub fn hold(sequence: &str, detector: &str, preset: &str, found: f64) {
    static WRITING: Mutex<()> = Mutex::new(());
    let key = format!("{sequence},{detector},{preset}");
    let read = || parse(&std::fs::read_to_string(file()).expect("the table ate.csv"));
    if std::env::var_os("STILLPOINT_BLESS").is_some() {
        let _one_at_a_time = WRITING.lock().expect("nobody panics while writing");
        let mut table = read();
        table.insert(key, found);
        std::fs::write(file(), print(&table)).expect("the table ate.csv can be written");
        return;
    }
    if let Some(complaint) = complaint(read().get(&key).copied(), found) {
        panic!(
            "{key}: {complaint}; if that is intended, renew crates/testdata/ate.csv: \
             STILLPOINT_BLESS=1 cargo test -p stillpoint -p stillpoint-cli --test all -- accuracy static_filter::scenes (CONTRIBUTING.md)"
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fifth_is_borne_and_more_is_not() {
        for (found, fine) in [
            (10.0, true),
            (11.9, true),
            (8.1, true),
            (12.1, false),
            (7.9, false),
            (f64::NAN, false),
        ] {
            assert_eq!(complaint(Some(10.0), found).is_none(), fine, "{found}");
        }
        assert!(complaint(None, 10.0).is_some());
    }

    #[test]
    fn the_table_is_as_it_is_written() {
        let text = std::fs::read_to_string(file()).expect("the table");
        assert_eq!(print(&parse(&text)), text);
    }
}
