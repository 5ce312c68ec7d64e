//! Text files of data sets: lists of stamped images, and association files.

use crate::error::{DatasetError, Result, quote};
use crate::regular::read_regular;
use crate::set_back::{Mended, SetBack, mend};
use crate::units::{BETWEEN_IMAGES, Unit};
use std::path::{Path, PathBuf};

pub(crate) struct Line<'a> {
    pub(crate) number: usize,
    /// Without surrounding blanks.
    pub(crate) text: &'a str,
}

impl<'a> Line<'a> {
    /// The columns, separated by blanks or commas.
    pub(crate) fn columns(&self) -> impl Iterator<Item = &'a str> + use<'a> {
        self.text
            .split(|c: char| c.is_whitespace() || c == ',')
            .filter(|s| !s.is_empty())
    }

    pub(crate) fn malformed(&self, path: &Path, expected: &str, found: String) -> DatasetError {
        DatasetError::Malformed {
            path: path.to_owned(),
            line: self.number,
            expected: expected.to_owned(),
            found,
            advice: "correct or remove the line (comments start with #)".to_owned(),
        }
    }
}

/// The lines that are neither blank nor comments.
pub(crate) fn data_lines(text: &str) -> impl Iterator<Item = Line<'_>> {
    text.strip_prefix('\u{feff}')
        .unwrap_or(text)
        .lines()
        .enumerate()
        .map(|(i, l)| Line {
            number: i + 1,
            text: l.trim(),
        })
        .filter(|l| !l.text.is_empty() && !l.text.starts_with('#'))
}

/// Maximum size of a text file, bytes: ground truth of a day at 100 Hz has some 600 MB.
const LONGEST_TEXT: u64 = 1 << 30;

/// Reads a text file; invalid UTF-8 becomes replacement characters, which the parsers then report with their line.
pub(crate) fn read_text(path: &Path) -> Result<String> {
    let bytes = read_regular(path, LONGEST_TEXT).map_err(|source| DatasetError::Read {
        path: path.to_owned(),
        source,
    })?;
    // Valid UTF-8 is not copied.
    Ok(String::from_utf8(bytes)
        .unwrap_or_else(|e| String::from_utf8_lossy(e.as_bytes()).into_owned()))
}

fn parse_number(line: &Line<'_>, word: &str, path: &Path, expected: &str) -> Result<f64> {
    match word.parse::<f64>() {
        Ok(x) if x.is_finite() => Ok(x),
        Ok(_) => Err(line.malformed(path, &format!("finite values in {expected}"), quote(word))),
        Err(_) => Err(line.malformed(path, expected, quote(word))),
    }
}

/// Exactly N finite numbers.
pub(crate) fn parse_numbers<const N: usize>(
    line: &Line<'_>,
    path: &Path,
    expected: &str,
) -> Result<[f64; N]> {
    let count = line.columns().count();
    if count != N {
        return Err(line.malformed(
            path,
            expected,
            format!("{count} columns: {}", quote(line.text)),
        ));
    }
    parse_first_numbers(line, path, expected)
}

/// The first N numbers of a line with at least as many columns; all must be finite.
pub(crate) fn parse_first_numbers<const N: usize>(
    line: &Line<'_>,
    path: &Path,
    expected: &str,
) -> Result<[f64; N]> {
    let count = line.columns().count();
    if count < N {
        let found = format!("{count} columns: {}", quote(line.text));
        return Err(line.malformed(path, expected, found));
    }
    let mut numbers = [0.0; N];
    for (slot, word) in numbers.iter_mut().zip(line.columns()) {
        *slot = parse_number(line, word, path, expected)?;
    }
    Ok(numbers)
}

/// A list of images with ascending stamps, s, and paths relative to the list's folder.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct ImageList {
    pub(crate) stamps: Vec<f64>,
    pub(crate) files: Vec<PathBuf>,
    lines: Vec<usize>,
}

/// Remarks about lists: guesses, warnings, and where the clock was set back.
#[derive(Debug, Default)]
pub(crate) struct Said {
    pub(crate) guesses: Vec<String>,
    pub(crate) warnings: Vec<String>,
    pub(crate) set_back: Vec<SetBack>,
}

impl ImageList {
    fn push(&mut self, line: &Line<'_>, stamp: f64, file: &str) {
        self.stamps.push(stamp);
        self.files.push(PathBuf::from(file));
        self.lines.push(line.number);
    }

    pub(crate) fn bring_to_seconds(&mut self, path: &Path, said: &mut Said) {
        let unit = Unit::of(&self.stamps, BETWEEN_IMAGES);
        self.stamps.iter_mut().for_each(|t| *t /= unit.per_second());
        said.guesses.extend(unit.remark(path));
    }

    /// Sorts the lines into a playable order, with warnings. `like` are the places where another list found the clock set back. Returns the
    /// lines' positions in the file.
    pub(crate) fn in_order(&mut self, path: &Path, like: &[SetBack], said: &mut Said) -> Mended {
        let mended = mend(&self.stamps, |_| None, like);
        let path = path.display();
        for at in &mended.set_back {
            let line = self.lines[at.index];
            said.warnings
                .push(Mended::remark(at, &format!("{path}:{line}")));
        }
        if mended.late > 0 {
            said.warnings.push(format!(
                "{path}: lines out of order by their stamps: {}; all are sorted",
                mended.late
            ));
        }
        if mended.repeats > 0 {
            said.warnings.push(format!(
                "{path}: lines that repeat a stamp and are left out: {}",
                mended.repeats
            ));
        }
        self.stamps = mended.stamps.iter().map(|s| s.0).collect();
        self.files = mended
            .stamps
            .iter()
            .map(|s| std::mem::take(&mut self.files[s.1]))
            .collect();
        mended
    }
}

/// Parses `rgb.txt` or `depth.txt`: `timestamp filename` per line, in file order.
pub(crate) fn parse_image_list(text: &str, path: &Path) -> Result<ImageList> {
    const EXPECTED: &str = "a timestamp and a file name";
    let mut list = ImageList::default();
    for line in data_lines(text) {
        // The name is everything after the stamp, and may contain blanks.
        let Some((stamp, file)) = line
            .text
            .split_once(|c: char| c.is_whitespace() || c == ',')
        else {
            return Err(line.malformed(path, EXPECTED, quote(line.text)));
        };
        let stamp = parse_number(&line, stamp, path, EXPECTED)?;
        list.push(&line, stamp, file.trim());
    }
    Ok(list)
}

/// An association file, with the stamps of both sides in s (or frame numbers, for ICL-NUIM).
#[derive(Debug, Default, PartialEq)]
pub(crate) struct Associations {
    pub(crate) colour: ImageList,
    pub(crate) depth: ImageList,
    /// Whether it lists depth before colour, as ICL-NUIM does.
    pub(crate) depth_first: bool,
}

impl Associations {
    /// Whether all stamps are integers: frame numbers, not seconds.
    pub(crate) fn is_numbered(&self) -> bool {
        let whole = |l: &ImageList| l.stamps.iter().all(|t| t.fract() == 0.0);
        whole(&self.colour) && whole(&self.depth)
    }
}

/// Parses an association file: `timestamp file timestamp file` per line. The names identify depth; otherwise colour comes first, as in the
/// TUM tools.
pub(crate) fn parse_associations(text: &str, path: &Path) -> Result<Associations> {
    const EXPECTED: &str = "timestamp, file, timestamp, file";
    let mut a = Associations::default();
    let mut first = true;
    for line in data_lines(text) {
        let words: Vec<&str> = line.columns().collect();
        let [stamp_a, file_a, stamp_b, file_b] = words[..] else {
            let found = format!("{} columns: {}", words.len(), quote(line.text));
            return Err(line.malformed(path, EXPECTED, found));
        };
        let stamp_a = parse_number(&line, stamp_a, path, EXPECTED)?;
        let stamp_b = parse_number(&line, stamp_b, path, EXPECTED)?;
        if first {
            a.depth_first = file_a.contains("depth") && !file_b.contains("depth");
            first = false;
        }
        let (c, d) = if a.depth_first {
            ((stamp_b, file_b), (stamp_a, file_a))
        } else {
            ((stamp_a, file_a), (stamp_b, file_b))
        };
        a.colour.push(&line, c.0, c.1);
        a.depth.push(&line, d.0, d.1);
    }
    Ok(a)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn image_lists_allow_comments_and_blanks_in_names() {
        let list = parse_image_list(
            "# head\n\n1.5 rgb/a b.png\r\n2.5,rgb/c.png\n",
            Path::new("rgb.txt"),
        )
        .unwrap();
        assert_eq!(list.stamps, [1.5, 2.5]);
        assert_eq!(
            list.files,
            [PathBuf::from("rgb/a b.png"), PathBuf::from("rgb/c.png")]
        );
    }

    #[test]
    fn malformed_lists_name_the_line() {
        for (text, parts) in [
            (
                "1 a.png\nnonsense\n",
                ["rgb.txt:2:", "a timestamp and a file name"],
            ),
            ("1 a.png\nx b.png\n", ["rgb.txt:2:", "\"x\""]),
            ("nan a.png\n", ["rgb.txt:1:", "finite"]),
        ] {
            let e = parse_image_list(text, Path::new("rgb.txt"))
                .unwrap_err()
                .to_string();
            assert!(parts.iter().all(|p| e.contains(p)), "{e}");
        }
    }

    /// The list in its playable order, with remarks.
    fn settled(lines: &[(&str, &str)]) -> (ImageList, Said) {
        let text: String = lines.iter().map(|(t, f)| format!("{t} {f}\n")).collect();
        let path = Path::new("rgb.txt");
        let mut said = Said::default();
        let mut list = parse_image_list(&text, path).unwrap();
        list.bring_to_seconds(path, &mut said);
        list.in_order(path, &[], &mut said);
        (list, said)
    }

    #[test]
    fn out_of_order_lines_are_sorted_and_repeats_dropped() {
        let (list, said) = settled(&[("2", "b"), ("1", "a"), ("3", "c"), ("3", "d"), ("4", "e")]);
        assert_eq!(list.stamps, [1.0, 2.0, 3.0, 4.0]);
        assert_eq!(list.files, ["a", "b", "c", "e"].map(PathBuf::from));
        let all = said.warnings.join("\n");
        assert!(
            all.contains("out of order by their stamps: 1") && all.contains("left out: 1"),
            "{all}"
        );
    }

    #[test]
    fn line_order_is_kept_after_a_backward_clock_jump() {
        let stamps: Vec<String> = (0..40)
            .map(|i| format!("{:.3}", f64::from(i) * 0.1 - if i < 20 { 0.0 } else { 1.0 }))
            .collect();
        let lines: Vec<(&str, &str)> = stamps.iter().map(|t| (t.as_str(), "x")).collect();
        let (list, said) = settled(&lines);
        assert!((list.stamps[39] - 3.9).abs() < 1e-6, "{:?}", list.stamps);
        assert!(
            said.warnings[0].contains("rgb.txt:21: stamps go back by 0.900 s"),
            "{:?}",
            said.warnings
        );
    }

    #[test]
    fn stamps_in_other_units_are_reported_and_converted() {
        let stamps: Vec<String> = (0..9)
            .map(|i| format!("{}", 1_305_031_102_175_304_000_u64 + i * 33_333_333))
            .collect();
        let lines: Vec<(&str, &str)> = stamps.iter().map(|t| (t.as_str(), "x")).collect();
        let (list, said) = settled(&lines);
        assert!((list.stamps[0] - 1_305_031_102.175_304).abs() < 1e-6);
        assert!(
            said.guesses[0].contains("nanoseconds"),
            "{:?}",
            said.guesses
        );
    }

    #[test]
    fn associations_identify_depth_by_file_name() {
        let tum = parse_associations("1 rgb/a.png 1.01 depth/b.png", Path::new("a")).unwrap();
        let icl = parse_associations("1.01 depth/b.png 1 rgb/a.png", Path::new("a")).unwrap();
        assert!(!tum.depth_first && icl.depth_first);
        assert_eq!((tum.colour, tum.depth), (icl.colour, icl.depth));
        let e = parse_associations("1 a.png 2\n", Path::new("a")).unwrap_err();
        assert!(e.to_string().contains("3 columns"), "{e}");
    }

    proptest! {
        #[test]
        fn random_text_never_panics(text in "\\PC{0,100}(\n\\PC{0,100}){0,4}") {
            let _ = parse_image_list(&text, Path::new("l"));
            let _ = parse_associations(&text, Path::new("l"));
        }

        #[test]
        fn random_bytes_never_panic(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
            let text = String::from_utf8_lossy(&bytes);
            let _ = parse_image_list(&text, Path::new("l"));
            let _ = parse_associations(&text, Path::new("l"));
        }
    }
}
