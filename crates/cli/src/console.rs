//! What the user sees: results on stdout, everything else on stderr, and a progress line on terminals.
//!
//! Writing never fails a command: when stdout or stderr is closed, the text is lost and the work goes on.

use std::io::{IsTerminal, Write};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::{Duration, Instant};

/// 0 errors only, 1 normal, 2 debug, 3 trace.
static VERBOSITY: AtomicU8 = AtomicU8::new(1);

/// Length of the progress line that stands on the terminal, in characters. One writer at a time.
static SHOWN: Mutex<usize> = Mutex::new(0);

/// How much is said, from `-q` and the number of `-v`.
pub(crate) fn set_verbosity(quiet: bool, verbose: u8) {
    let level = if quiet { 0 } else { 1 + verbose.min(2) };
    VERBOSITY.store(level, Ordering::Relaxed);
}

/// The level set by [`set_verbosity`].
pub(crate) fn verbosity() -> u8 {
    VERBOSITY.load(Ordering::Relaxed)
}

/// Prints a result to stdout, as it is.
pub(crate) fn print(text: &str) {
    let _ = std::io::stdout().lock().write_all(text.as_bytes());
}

/// Prints a result to stdout unless `-q` was given.
pub(crate) fn report(text: &str) {
    if verbosity() > 0 {
        print(text);
    }
}

/// A line on stderr, whatever the verbosity.
pub(crate) fn line(text: &str) {
    write_over(text, true);
}

/// A line of information on stderr, silent with `-q`.
pub(crate) fn info(text: &str) {
    if verbosity() > 0 {
        line(text);
    }
}

/// A warning on stderr, silent with `-q`.
pub(crate) fn warn(text: &str) {
    if verbosity() > 0 {
        line(&format!("warning: {text}"));
    }
}

/// Writes over the progress line. Without `end_line` the text becomes the new progress line.
fn write_over(text: &str, end_line: bool) {
    // A poisoned lock only means that a thread panicked while writing: the number in it is still good enough.
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
    let _ = write!(stderr, "{blank}{text}{}", if end_line { "\n" } else { "" });
    let _ = stderr.flush();
    *shown = if end_line { 0 } else { text.chars().count() };
}

/// A bar on terminals; a line every ten seconds elsewhere; nothing with `-q`.
pub(crate) struct Progress {
    total: Option<usize>,
    terminal: bool,
    start: Instant,
    last: Instant,
}

/// Between two drawings of the bar: ten a second look smooth and cost nothing.
const REDRAW: Duration = Duration::from_millis(100);
/// Between two lines where there is no terminal.
const REPEAT: Duration = Duration::from_secs(10);

impl Progress {
    /// Begins. `total` is the number of frames, where known.
    pub(crate) fn new(total: Option<usize>) -> Self {
        let now = Instant::now();
        Self {
            total,
            terminal: std::io::stderr().is_terminal(),
            start: now,
            last: now,
        }
    }

    /// Shows how far it is, now and then. `note` is appended.
    pub(crate) fn show(&mut self, done: usize, note: &str) {
        let pause = if self.terminal { REDRAW } else { REPEAT };
        if verbosity() == 0 || self.last.elapsed() < pause {
            return;
        }
        self.last = Instant::now();
        let text = progress_text(done, self.total, self.start.elapsed(), note, self.terminal);
        write_over(&text, !self.terminal);
    }

    /// Removes the bar.
    pub(crate) fn finish(&self) {
        if self.terminal && verbosity() > 0 {
            write_over("", false);
        }
    }
}

fn progress_text(
    done: usize,
    total: Option<usize>,
    elapsed: Duration,
    note: &str,
    bar: bool,
) -> String {
    const WIDTH: usize = 30;
    let rate = done as f64 / elapsed.as_secs_f64().max(1e-3);
    let Some(total) = total else {
        return format!("{done} frames, {rate:.0} fps{note}");
    };
    let total = total.max(1);
    let left = total.saturating_sub(done) as f64 / rate.max(1e-3);
    let counts = format!("{done}/{total} frames, {rate:.0} fps, {left:.0} s left{note}");
    if bar {
        let full = (WIDTH * done / total).min(WIDTH);
        format!(
            "[{}{}] {counts}",
            "=".repeat(full),
            " ".repeat(WIDTH - full)
        )
    } else {
        counts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn progress_says_where_it_is() {
        let t =
            |done, total, bar| progress_text(done, total, Duration::from_secs(2), ", 1 lost", bar);
        assert_eq!(
            t(60, Some(120), false),
            "60/120 frames, 30 fps, 2 s left, 1 lost"
        );
        assert!(t(60, Some(120), true).starts_with(&format!(
            "[{}{}] 60/120",
            "=".repeat(15),
            " ".repeat(15)
        )));
        assert!(t(200, Some(120), true).contains(&"=".repeat(30)));
        assert_eq!(t(4, None, true), "4 frames, 2 fps, 1 lost");
    }
}
