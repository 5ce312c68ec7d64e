//! User output: results on stdout, everything else on stderr, and a progress line on terminals.
//!
//! Write errors do not end a command; a failure of stdout is reported at the end of the program ([`lost`]), except where the reader closed
//! the pipe.

use std::borrow::Cow;
use std::io::{ErrorKind, IsTerminal, Write};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::{Duration, Instant};

/// 0 errors only, 1 normal, 2 debug, 3 trace.
static VERBOSITY: AtomicU8 = AtomicU8::new(1);

/// Length of the progress line currently on the terminal, in characters. The lock also serialises writers.
static SHOWN: Mutex<usize> = Mutex::new(0);

pub(crate) fn set_verbosity(quiet: bool, verbose: u8) {
    let level = if quiet { 0 } else { 1 + verbose.min(2) };
    VERBOSITY.store(level, Ordering::Relaxed);
}

pub(crate) fn verbosity() -> u8 {
    VERBOSITY.load(Ordering::Relaxed)
}

/// The first error of writing to stdout.
static LOST: Mutex<Option<std::io::Error>> = Mutex::new(None);

pub(crate) fn print(text: &str) {
    let mut stdout = std::io::stdout().lock();
    let text = harmless(text);
    // Buffered output could still fail, so flush.
    let written = stdout
        .write_all(text.as_bytes())
        .and_then(|()| stdout.flush());
    if let Err(e) = written
        && e.kind() != ErrorKind::BrokenPipe
        && let Ok(mut lost) = LOST.lock()
    {
        lost.get_or_insert(e);
    }
}

/// The first error of writing a result to stdout, if any.
pub(crate) fn lost() -> Option<std::io::Error> {
    LOST.lock().ok()?.take()
}

/// Replaces control and direction characters, since file names and lists come from others: escape sequences would be executed by the
/// terminal, and a change of writing direction can disguise a name.
pub(crate) fn harmless(text: &str) -> Cow<'_, str> {
    let obeyed = |c: char| {
        (c.is_control() && c != '\n' && c != '\t')
            || matches!(c, '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
    };
    if !text.contains(obeyed) {
        return Cow::Borrowed(text);
    }
    let mut shown = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if obeyed(c) {
            shown.extend(c.escape_default());
        } else {
            shown.push(c);
        }
    }
    Cow::Owned(shown)
}

/// Prints a result to stdout unless `-q` was given.
pub(crate) fn report(text: &str) {
    if verbosity() > 0 {
        print(text);
    }
}

pub(crate) fn is_quiet() -> bool {
    verbosity() == 0
}

/// Prints a line to stderr at any verbosity.
pub(crate) fn line(text: &str) {
    write_over(text, true);
}

pub(crate) fn info(text: &str) {
    if verbosity() > 0 {
        line(text);
    }
}

pub(crate) fn warn(text: &str) {
    if verbosity() > 0 {
        line(&format!("warning: {text}"));
    }
}

/// Overwrites the progress line. Without `end_line` the text becomes the new progress line.
fn write_over(text: &str, end_line: bool) {
    // A poisoned lock only means that a thread panicked while writing: the length is still usable.
    let mut shown = match SHOWN.lock() {
        Ok(guard) => guard,
        Err(poisoned) => poisoned.into_inner(),
    };
    let mut stderr = std::io::stderr().lock();
    let blank = if *shown > 0 {
        format!("\r{}\r", " ".repeat(*shown))
    } else {
        String::new()
    };
    let text = harmless(text);
    let _ = write!(stderr, "{blank}{text}{}", if end_line { "\n" } else { "" });
    let _ = stderr.flush();
    *shown = if end_line { 0 } else { text.chars().count() };
}

/// Width of the terminal on stderr, in characters.
fn columns() -> usize {
    #[cfg(target_os = "linux")]
    let found = rustix::termios::tcgetwinsize(std::io::stderr()).map(|size| size.ws_col);
    #[cfg(not(target_os = "linux"))]
    let found = Err::<u16, ()>(());
    // Some terminals report 0.
    found.map_or(80, |columns| match columns {
        0 => 80,
        n => usize::from(n),
    })
}

/// A count with its noun, whose plural is regular.
pub(crate) fn counted(n: usize, noun: &str) -> String {
    match n {
        1 => format!("1 {noun}"),
        _ => format!("{n} {noun}s"),
    }
}

/// Frames per second; below one, the time per frame.
pub(crate) fn frame_rate(rate: f64, unit: &str) -> String {
    if rate < 1.0 {
        return format!("{:.1} s per frame", 1.0 / rate.max(1e-3));
    }
    format!("{rate:.0} {unit}")
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Unit {
    Frames,
    Images,
    /// Shown in megabytes.
    Bytes,
}

impl Unit {
    fn number(self, n: usize) -> String {
        match self {
            Self::Bytes => format!("{:.1}", n as f64 * 1e-6),
            _ => n.to_string(),
        }
    }

    /// The unit after counts.
    fn name(self) -> &'static str {
        match self {
            Self::Frames => "frames",
            Self::Images => "images",
            Self::Bytes => "MB",
        }
    }

    /// A rate, given per second.
    fn rate(self, rate: f64) -> String {
        match self {
            Self::Frames => frame_rate(rate, "fps"),
            Self::Images if rate < 1.0 => format!("{:.1} s each", 1.0 / rate.max(1e-3)),
            Self::Images => format!("{rate:.1} per s"),
            Self::Bytes if rate < 1e6 => format!("{:.0} kB/s", rate * 1e-3),
            Self::Bytes => format!("{:.1} MB/s", rate * 1e-6),
        }
    }
}

/// A bar on terminals; a line every ten seconds elsewhere; nothing with `-q`.
pub(crate) struct Progress {
    unit: Unit,
    total: Option<usize>,
    /// The count at the start, left out of the rate.
    before: usize,
    terminal: bool,
    bar: bool,
    start: Instant,
    last: Instant,
}

/// Interval between redraws of the bar: ten per second look smooth at negligible cost.
const REDRAW: Duration = Duration::from_millis(100);
/// Interval between lines without a terminal.
const REPEAT: Duration = Duration::from_secs(10);

impl Progress {
    /// Starts counting frames. `total` is the number of frames, where known.
    pub(crate) fn new(total: Option<usize>) -> Self {
        Self::of(Unit::Frames, total, 0)
    }

    /// Starts counting. `before` is the count already done.
    pub(crate) fn of(unit: Unit, total: Option<usize>, before: usize) -> Self {
        let now = Instant::now();
        Self {
            unit,
            total,
            before,
            terminal: std::io::stderr().is_terminal(),
            bar: true,
            start: now,
            last: now,
        }
    }

    /// Hides the bar, for commands that show more than a count.
    pub(crate) fn without_bar(mut self) -> Self {
        self.bar = false;
        self
    }

    /// Updates the display at limited rate. `note` is appended.
    pub(crate) fn show(&mut self, done: usize, note: &str) {
        let pause = if self.terminal { REDRAW } else { REPEAT };
        if verbosity() == 0 || self.last.elapsed() < pause {
            return;
        }
        self.last = Instant::now();
        let mut text = self.text(done, self.start.elapsed(), note);
        if self.terminal {
            // A wrapped line could not be overwritten.
            text = text.chars().take(columns() - 1).collect();
        }
        write_over(&text, !self.terminal);
    }

    pub(crate) fn finish(&self) {
        if self.terminal && verbosity() > 0 {
            write_over("", false);
        }
    }

    fn text(&self, done: usize, elapsed: Duration, note: &str) -> String {
        const WIDTH: usize = 30;
        let (unit, name) = (self.unit, self.unit.name());
        let rate = done.saturating_sub(self.before) as f64 / elapsed.as_secs_f64().max(1e-3);
        let (count, speed) = (unit.number(done), unit.rate(rate));
        let Some(total) = self.total else {
            return format!("{count} {name}, {speed}{note}");
        };
        let total = total.max(1);
        let left = total.saturating_sub(done) as f64 / rate.max(1e-3);
        let counts = format!(
            "{count}/{} {name}, {speed}, {left:.0} s left{note}",
            unit.number(total)
        );
        if self.terminal && self.bar {
            // As floats: the product of two byte counts may overflow.
            let full = (WIDTH as f64 * (done as f64 / total as f64)) as usize;
            let full = full.min(WIDTH);
            format!(
                "[{}{}] {counts}",
                "=".repeat(full),
                " ".repeat(WIDTH - full)
            )
        } else {
            counts
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn progress_shows_count_rate_and_time_left() {
        let t = |done, total, terminal| {
            let progress = Progress {
                terminal,
                ..Progress::new(total)
            };
            progress.text(done, Duration::from_secs(2), ", 1 lost")
        };
        assert_eq!(
            t(60, Some(120), false),
            "60/120 frames, 30 fps, 2 s left, 1 lost"
        );
        assert!(t(60, Some(120), true).starts_with(&format!(
            "[{}{}] 60/120",
            "=".repeat(15),
            " ".repeat(15)
        )));
        let plain = Progress::new(Some(120)).without_bar();
        let text = plain.text(60, Duration::from_secs(2), " | well");
        assert_eq!(text, "60/120 frames, 30 fps, 2 s left | well");
        assert!(t(200, Some(120), true).contains(&"=".repeat(30)));
        assert_eq!(t(4, None, true), "4 frames, 2 fps, 1 lost");
    }

    #[test]
    fn control_characters_are_escaped() {
        assert_eq!(
            harmless("plain, \u{fc}ml\u{e4}ut\tand\nlines"),
            "plain, \u{fc}ml\u{e4}ut\tand\nlines"
        );
        assert_eq!(harmless("a\u{1b}]0;title\u{7}b"), "a\\u{1b}]0;title\\u{7}b");
        assert_eq!(harmless("x\r\u{9b}2Jy"), "x\\r\\u{9b}2Jy");
        assert_eq!(harmless("gnp.\u{202e}exe"), "gnp.\\u{202e}exe");
    }

    #[test]
    fn slow_rates_are_shown_as_time_per_item() {
        let said = |unit, done| {
            let progress = Progress {
                terminal: false,
                ..Progress::of(unit, None, 0)
            };
            progress.text(done, Duration::from_secs(10), "")
        };
        assert_eq!(said(Unit::Frames, 4), "4 frames, 2.5 s per frame");
        assert_eq!(said(Unit::Images, 2), "2 images, 5.0 s each");
        assert_eq!(said(Unit::Bytes, 400_000), "0.4 MB, 40 kB/s");
        assert_eq!(counted(1, "frame"), "1 frame");
        assert_eq!(counted(0, "frame"), "0 frames");
    }

    #[test]
    fn resumed_download_rate_excludes_the_earlier_part() {
        let progress = Progress {
            terminal: false,
            ..Progress::of(Unit::Bytes, Some(20_000_000), 10_000_000)
        };
        assert_eq!(
            progress.text(12_000_000, Duration::from_secs(2), ""),
            "12.0/20.0 MB, 1.0 MB/s, 8 s left"
        );
    }
}
