//! Table of expected errors of runs: `ate.csv` beside this crate's `src`. Tests compare their results with its rows, so
//! that a change that makes a run a fifth worse or better, or loses frames, is noticed. The table does not define
//! acceptable errors: its differences are reviewed when it is renewed.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::PathBuf;
use std::sync::Mutex;

/// Tolerance as a share of the expected value: of the error, and of the frames without a pose.
const BAND: f64 = 0.2;
/// Minimum tolerance of the error, mm: the variation of the quietest simulated scenes between seeds.
const FLOOR_MM: f64 = 0.1;
const HEAD: &str = "sequence,detector,preset,error_mm,frames,posed";
/// The command that writes the whole table anew, as in CONTRIBUTING.md.
const RENEW: &str = "tools/errors";

/// Result of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Figures {
    /// Error, mm: the RMSE of the ATE, of the drift of a static camera, or as named by the sequence.
    pub error_mm: f64,
    /// Number of frames.
    pub frames: usize,
    /// Number of frames with a final pose.
    pub posed: usize,
}

impl Figures {
    /// A run in which every frame has a pose.
    #[must_use]
    pub fn all_posed(error_mm: f64, frames: usize) -> Self {
        Self {
            error_mm,
            frames,
            posed: frames,
        }
    }
}

type Table = BTreeMap<String, Figures>;

fn file() -> PathBuf {
    [env!("CARGO_MANIFEST_DIR"), "ate.csv"].iter().collect()
}

fn parse(text: &str) -> Table {
    let number = |column: &str| column.parse().expect("a count of frames");
    let rows = text.lines().skip(1).map(|line| {
        let mut columns = line.rsplitn(4, ',');
        let mut next = || columns.next().expect("six columns");
        let (posed, frames, error) = (number(next()), number(next()), next());
        let figures = Figures {
            error_mm: error.parse().expect("error_mm: a number"),
            frames,
            posed,
        };
        (next().to_owned(), figures)
    });
    rows.collect()
}

fn print(table: &Table) -> String {
    let mut text = format!("{HEAD}\n");
    for (key, found) in table {
        let Figures {
            error_mm,
            frames,
            posed,
        } = found;
        writeln!(text, "{key},{error_mm:.2},{frames},{posed}").expect("strings take everything");
    }
    text
}

fn key(sequence: &str, detector: &str, preset: &str) -> String {
    let columns = [sequence, detector, preset];
    assert!(!columns.iter().any(|c| c.contains(',')), "{columns:?}");
    columns.join(",")
}

/// The difference between a run and its row, if beyond the tolerance.
fn complaint(expected: Option<Figures>, found: Figures) -> Option<String> {
    let Some(expected) = expected else {
        return Some(format!("found {found:?}, and no row in the table"));
    };
    let most = FLOOR_MM.max(BAND * expected.error_mm);
    // Zero tolerance if all frames have poses.
    let lost = expected.frames.abs_diff(expected.posed);
    let more = (BAND * lost as f64).ceil() as usize;
    // NaN counts as a difference.
    let near = (found.error_mm - expected.error_mm).abs() <= most
        && found.frames == expected.frames
        && found.posed.abs_diff(expected.posed) <= more;
    (!near).then(|| {
        format!(
            "expected {:.2} mm ± {most:.2} and {} ± {more} poses of {} frames, found {:.2} mm and {} of {}",
            expected.error_mm,
            expected.posed,
            expected.frames,
            found.error_mm,
            found.posed,
            found.frames
        )
    })
}

fn read() -> Table {
    parse(&std::fs::read_to_string(file()).expect("the table ate.csv"))
}

/// Compares a run with its row, identified by sequence, detector and preset of the static filter, all without commas.
/// With `STILLPOINT_BLESS` set it writes the row instead.
///
/// # Panics
/// When the error or the number of frames without a pose differs by more than 20 %, or there is no row.
#[track_caller]
pub fn hold(sequence: &str, detector: &str, preset: &str, found: Figures) {
    static WRITING: Mutex<()> = Mutex::new(());
    let key = key(sequence, detector, preset);
    if std::env::var_os("STILLPOINT_BLESS").is_some() {
        let _one_at_a_time = WRITING.lock().expect("nobody panics while writing");
        let mut table = read();
        table.insert(key, found);
        std::fs::write(file(), print(&table)).expect("the table ate.csv can be written");
        return;
    }
    if let Some(complaint) = complaint(read().get(&key).copied(), found) {
        panic!("{key}: {complaint}; if that is intended, renew crates/testdata/ate.csv: {RENEW}");
    }
}

/// The error in the table, mm, for results that must be near it, such as runs of another seed.
///
/// # Panics
/// When there is no row.
#[must_use]
pub fn expected_mm(sequence: &str, detector: &str, preset: &str) -> f64 {
    let key = key(sequence, detector, preset);
    let row = read().get(&key).copied();
    row.unwrap_or_else(|| panic!("{key}: no row in ate.csv"))
        .error_mm
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figures(error_mm: f64, posed: usize) -> Figures {
        Figures {
            error_mm,
            frames: 100,
            posed,
        }
    }

    #[test]
    fn error_may_change_by_a_fifth() {
        for (expected, found, fine) in [
            (10.0, 10.0, true),
            (10.0, 11.9, true),
            (10.0, 8.1, true),
            (10.0, 12.1, false),
            (10.0, 7.9, false),
            (10.0, f64::NAN, false),
            // The minimum tolerance applies.
            (0.3, 0.39, true),
            (0.3, 0.41, false),
        ] {
            let complaint = complaint(Some(figures(expected, 100)), figures(found, 100));
            assert_eq!(complaint.is_none(), fine, "{found}");
        }
        assert!(complaint(None, figures(10.0, 100)).is_some());
    }

    #[test]
    fn lost_frames_may_change_by_a_fifth() {
        for (expected, found, fine) in [
            (100, 100, true),
            (100, 99, false),
            (90, 88, true),
            (90, 92, true),
            (90, 87, false),
            (90, 93, false),
        ] {
            let complaint = complaint(Some(figures(1.0, expected)), figures(1.0, found));
            assert_eq!(complaint.is_none(), fine, "{found}");
        }
        let shorter = Figures {
            frames: 99,
            ..figures(1.0, 99)
        };
        assert!(complaint(Some(figures(1.0, 100)), shorter).is_some());
    }

    #[test]
    fn table_round_trips_through_its_text() {
        let text = std::fs::read_to_string(file()).expect("the table");
        assert_eq!(print(&parse(&text)), text);
    }
}
