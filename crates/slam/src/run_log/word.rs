//! Arbitrary text as one word of a line.

use std::fmt::Write;

/// Quotes text as one ASCII word: spaces as `\s`, backslashes, quotes and non-ASCII characters as `\u{..}`.
pub(super) fn escaped(text: &str) -> String {
    let mut out = String::from("\"");
    for c in text.chars() {
        if c.is_ascii_graphic() && c != '\\' && c != '"' {
            out.push(c);
        } else if c == ' ' {
            out.push_str("\\s");
        } else {
            let _ = write!(out, "\\u{{{:x}}}", u32::from(c));
        }
    }
    out.push('"');
    out
}

/// Inverse of [`escaped`]; `None` for invalid input.
pub(super) fn unescaped(word: &str) -> Option<String> {
    let mut rest = word.strip_prefix('"')?.strip_suffix('"')?;
    let mut out = String::new();
    while let Some(c) = rest.chars().next() {
        if let Some(after) = rest.strip_prefix("\\s") {
            out.push(' ');
            rest = after;
        } else if let Some(after) = rest.strip_prefix("\\u{") {
            let (code, after) = after.split_once('}')?;
            out.push(char::from_u32(u32::from_str_radix(code, 16).ok()?)?);
            rest = after;
        } else if c == '\\' {
            return None;
        } else {
            out.push(c);
            rest = &rest[c.len_utf8()..];
        }
    }
    Some(out)
}
