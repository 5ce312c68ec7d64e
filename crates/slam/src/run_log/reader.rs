//! Reads the lines of a log and their words.

use super::LogError;
use super::word::unescaped;
use std::str::{FromStr, Lines, SplitAsciiWhitespace};
use stillpoint_detection::ClassId;
use stillpoint_imaging::FrameId;
use stillpoint_map::KeyframeId;

/// Prefix of lines about the run.
pub(super) const ABOUT: &str = "| ";

#[derive(Clone, Copy)]
pub(super) struct Line<'a> {
    number: usize,
    pub(super) text: &'a str,
}

pub(super) struct AllLines<'a> {
    lines: Lines<'a>,
    number: usize,
}

impl<'a> Iterator for AllLines<'a> {
    type Item = Line<'a>;

    fn next(&mut self) -> Option<Line<'a>> {
        self.number += 1;
        let number = self.number;
        self.lines.next().map(|text| Line { number, text })
    }
}

impl<'a> Line<'a> {
    pub(super) fn all(text: &'a str) -> AllLines<'a> {
        AllLines {
            lines: text.lines(),
            number: 0,
        }
    }

    /// The next line, which must exist.
    pub(super) fn next(lines: &mut AllLines<'a>) -> Result<Self, LogError> {
        lines.next().ok_or_else(|| LogError {
            line: lines.number,
            expected: "another line".to_owned(),
            found: "the end of the text: the log was not written to its end".to_owned(),
        })
    }

    pub(super) fn error(&self, expected: &str) -> LogError {
        let shown: String = self.text.chars().take(80).collect();
        LogError {
            line: self.number,
            expected: expected.to_owned(),
            found: format!("{shown:?}"),
        }
    }

    /// The words after the first, which must be `name`.
    pub(super) fn words(&self, name: &str) -> Result<Words<'a>, LogError> {
        let mut words = self.text.split_ascii_whitespace();
        match words.next() {
            Some(first) if first == name => Ok(Words { line: *self, words }),
            _ => Err(self.error(&format!("{name:?}"))),
        }
    }

    /// The text of a line about the run; `None` for other lines.
    pub(super) fn about(&self) -> Result<Option<String>, LogError> {
        match self.text.strip_prefix(ABOUT) {
            None => Ok(None),
            Some(said) if !said.starts_with('"') => Ok(Some(said.to_owned())),
            Some(said) => match unescaped(said) {
                Some(said) => Ok(Some(said)),
                None => Err(self.error("a text in quotes")),
            },
        }
    }

    pub(super) fn only_hex(&self, name: &str) -> Result<u64, LogError> {
        let mut words = self.words(name)?;
        let value = words.hex("16 hexadecimal digits")?;
        words.finish()?;
        Ok(value)
    }
}

pub(super) struct Words<'a> {
    pub(super) line: Line<'a>,
    words: SplitAsciiWhitespace<'a>,
}

impl<'a> Words<'a> {
    pub(super) fn word(&mut self, expected: &str) -> Result<&'a str, LogError> {
        self.words.next().ok_or_else(|| self.line.error(expected))
    }

    pub(super) fn number<T: FromStr>(&mut self, expected: &str) -> Result<T, LogError> {
        let word = self.word(expected)?;
        word.parse().map_err(|_| self.line.error(expected))
    }

    pub(super) fn hex(&mut self, expected: &str) -> Result<u64, LogError> {
        let word = self.word(expected)?;
        let digits = word.len() == 16 && word.bytes().all(|b| b.is_ascii_hexdigit());
        let value = u64::from_str_radix(word, 16).ok().filter(|_| digits);
        value.ok_or_else(|| self.line.error(expected))
    }

    pub(super) fn frame(&mut self) -> Result<FrameId, LogError> {
        self.number("the number of a frame").map(FrameId)
    }

    pub(super) fn keyframe(&mut self) -> Result<KeyframeId, LogError> {
        self.number("the number of a keyframe").map(KeyframeId)
    }

    pub(super) fn version(&mut self) -> Result<u64, LogError> {
        self.number("a version of the map")
    }

    pub(super) fn class(&mut self) -> Result<ClassId, LogError> {
        let expected = "a class from 0 to 79";
        let class = self.number(expected)?;
        if usize::from(class) < ClassId::COUNT {
            Ok(ClassId(class))
        } else {
            Err(self.line.error(expected))
        }
    }

    /// A text written with [`escaped`].
    pub(super) fn text(&mut self) -> Result<String, LogError> {
        let word = self.word("a text in quotes")?;
        unescaped(word).ok_or_else(|| self.line.error("a text in quotes"))
    }

    pub(super) fn size(&mut self) -> Result<(usize, usize), LogError> {
        Ok((self.number("a width")?, self.number("a height")?))
    }

    pub(super) fn finish(mut self) -> Result<(), LogError> {
        match self.words.next() {
            None => Ok(()),
            Some(_) => Err(self.line.error("nothing more in this line")),
        }
    }
}
