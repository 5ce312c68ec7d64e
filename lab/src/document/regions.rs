//! The generated regions of a document.

use crate::Failure;

const BEGIN: &str = "<!-- lab: ";
const CLOSE: &str = " -->";
const END: &str = "<!-- /lab -->";

#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Region {
    pub(crate) name: String,
    /// Number of the table in the file, from 1.
    pub(crate) number: usize,
    /// Without the line about the table's origin.
    pub(crate) bare: bool,
    /// View of the runs; `None` shows the whole table.
    pub(crate) view: Option<View>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum View {
    /// Errors, a column per variant.
    Variants,
    /// Relative errors over 1 s, a column per variant.
    Motion,
    /// All errors, without times.
    Errors,
    /// Times by stage.
    Stages,
    Latency,
}

impl View {
    fn named(word: &str) -> Option<Self> {
        Some(match word {
            "variants" => Self::Variants,
            "motion" => Self::Motion,
            "errors" => Self::Errors,
            "stages" => Self::Stages,
            "latency" => Self::Latency,
            _ => return None,
        })
    }
}

impl Region {
    fn parse(words: &str) -> Result<Self, Failure> {
        let wrong = || {
            format!(
                "expected `{BEGIN}NAME [NUMBER] [bare] [variants|motion|errors|stages|latency]{CLOSE}`, found {words:?}"
            )
        };
        let mut all = words.split_whitespace();
        let name = all.next().ok_or_else(wrong)?;
        let mut region = Self {
            name: name.to_owned(),
            number: 1,
            bare: false,
            view: None,
        };
        for word in all {
            match word.parse() {
                Ok(number) if number > 0 => region.number = number,
                _ if word == "bare" => region.bare = true,
                _ => region.view = Some(View::named(word).ok_or_else(wrong)?),
            }
        }
        Ok(region)
    }
}

/// A text with the content of its regions replaced.
pub(crate) fn replace(
    text: &str,
    mut render: impl FnMut(&Region) -> Result<String, Failure>,
) -> Result<String, Failure> {
    let mut fresh = String::with_capacity(text.len());
    let mut open: Option<(usize, String)> = None;
    for (i, line) in text.split_inclusive('\n').enumerate() {
        let at = |e: Failure| -> Failure { format!("line {}: {e}", i + 1).into() };
        let bare = line.trim();
        match &open {
            None => {
                fresh += line;
                let begun = bare.strip_prefix(BEGIN).and_then(|l| l.strip_suffix(CLOSE));
                if let Some(words) = begun {
                    let region = Region::parse(words).map_err(at)?;
                    let inside = render(&region).map_err(at)?;
                    open = Some((i + 1, inside));
                } else if bare == END {
                    return Err(at(format!(
                        "expected {BEGIN}NAME{CLOSE} before it, found none"
                    )
                    .into()));
                }
            }
            Some((begun, inside)) => {
                if bare == END {
                    // In every dialect of Markdown a blank line ends the table.
                    fresh += &format!("{inside}\n");
                    fresh += line;
                    open = None;
                } else if bare.starts_with(BEGIN) {
                    return Err(at(format!(
                        "expected {END} of line {begun}, found another region"
                    )
                    .into()));
                }
            }
        }
    }
    match open {
        Some((begun, _)) => {
            Err(format!("line {begun}: expected {END} after it, found none").into())
        }
        None => Ok(fresh),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_region_contents_are_regenerated() {
        let text = "a\n<!-- lab: x 2 bare -->\nold\n\nold\n<!-- /lab -->\nb\n<!-- lab: y -->\n<!-- /lab -->";
        let mut asked = Vec::new();
        let mut make = |region: &Region| {
            asked.push(region.clone());
            Ok(format!("| {} |\n", region.name))
        };
        let fresh = replace(text, &mut make).unwrap();
        assert_eq!(
            fresh,
            "a\n<!-- lab: x 2 bare -->\n| x |\n\n<!-- /lab -->\nb\n<!-- lab: y -->\n| y |\n\n<!-- /lab -->"
        );
        assert_eq!(replace(&fresh, &mut make).unwrap(), fresh);
        let first = Region {
            name: "x".to_owned(),
            number: 2,
            bare: true,
            view: None,
        };
        assert_eq!(asked[0], first);
    }

    #[test]
    fn unmatched_region_markers_are_errors() {
        for (text, part) in [
            (
                "<!-- lab: x -->\nold",
                "line 1: expected <!-- /lab --> after it",
            ),
            ("<!-- /lab -->", "before it, found none"),
            (
                "<!-- lab: x -->\n<!-- lab: y -->\n",
                "line 2: expected <!-- /lab --> of line 1",
            ),
            ("<!-- lab: x 0 -->\n<!-- /lab -->", "[NUMBER]"),
        ] {
            let e = replace(text, |_| Ok(String::new()))
                .unwrap_err()
                .to_string();
            assert!(e.contains(part), "{e}");
        }
    }
}
