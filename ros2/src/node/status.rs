//! Status messages and diagnostics of the node.

use super::{Node, REPEAT, STATUS, now};
use crate::waiting::diagnostics;
use std::time::Instant;
use stillpoint::ros_events::{Outgoing, Topic};
use stillpoint::ros_messages::{Format, to_bytes};

impl Node {
    pub(super) fn tell_status(&mut self) {
        let now_is = Instant::now();
        let since = now_is.saturating_duration_since(self.status_at);
        if since < STATUS {
            return;
        }
        self.status_at = now_is;
        let misfits = self.intake.misfits(&mut self.bus);
        for (misfit, what) in misfits.into_iter().zip(["colour", "depth"]) {
            if misfit {
                self.voice.warn(&format!(
                    "a publisher of {what} images is best effort, and reliability is reliable: nothing comes of it; start with -p reliability:=best_effort"
                ));
            }
        }
        let reliable = self.options.reliable;
        if let Some(told) = self.losses.update(now_is, &self.intake.seen, reliable) {
            match self.losses.now() {
                Some(_) => self.voice.warn(&told),
                None => self.voice.info(&told),
            }
        }
        let seen = self.intake.state(self.losses.now());
        let missing = seen.missing(now_is, self.last_pair, self.options.max_dt);
        let missing = missing
            .or_else(|| {
                self.refused
                    .clone()
                    .map(|_| "reset: no run begins".to_owned())
            })
            .or_else(|| self.not_ready.clone())
            .or_else(|| {
                let why = self.unreadable.as_ref()?;
                Some(format!("frames that can be made: {why}"))
            })
            .filter(|_| !self.paused);
        let counts = [seen.streams[0].count, seen.streams[1].count];
        let rate = |i: usize| (counts[i] - self.counted[i]) as f64 / since.as_secs_f64();
        let message = diagnostics(&seen, missing.as_deref(), [rate(0), rate(1)], now());
        self.outputs.send(&Outgoing {
            topic: Topic::Diagnostics,
            time: 0,
            bytes: to_bytes(&message, Format::CdrLittleEndian),
        });
        let comes = missing.is_none();
        if let Some(told) = self.waiting.update(now_is, missing) {
            if comes {
                self.voice.info(&told);
            } else {
                self.voice.warn(&told);
            }
        }
        self.counted = counts;
        if let Some(run) = &self.run {
            for (stage, state) in run.watch().health().troubles() {
                self.repeat(&format!("{stage}: {state}"));
            }
        }
    }

    /// Prints a warning, but not with every image.
    pub(super) fn repeat(&mut self, what: &str) {
        let now = Instant::now();
        self.said.retain(|_, at| now.duration_since(*at) < REPEAT);
        if !self.said.contains_key(what) && self.said.len() < 20 {
            self.said.insert(what.to_owned(), now);
            self.voice.warn(what);
        }
    }
}
