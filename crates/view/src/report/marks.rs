//! What happened in a run that is worth finding again.

use super::model::{Mark, MarkKind};
use stillpoint_slam::{Event, LoopOutcome, Outcome};

/// The mark of an event that brings one. Losses are none of it: they are known by frames.
pub(crate) fn mark_of(event: &Event) -> Option<Mark> {
    let (frame, kind, text) = match event {
        Event::Frame(event) => match event.report.outcome {
            Outcome::Initialised => (
                event.report.frame.0,
                MarkKind::Begun,
                "a map began".to_owned(),
            ),
            Outcome::Relocalised { with, .. } => (
                event.report.frame.0,
                MarkKind::Found,
                format!("found again at keyframe {with}"),
            ),
            _ => return None,
        },
        Event::Looped(report) if report.outcome == LoopOutcome::Closed => {
            let what = if report.joined.is_some() {
                "joined submaps"
            } else {
                "closed a loop"
            };
            let moved = 1e3 * report.moved_m;
            let with = report.with;
            let text = format!("{what} with keyframe {with}: moved up to {moved:.0} mm");
            (report.keyframe.0, MarkKind::Loop, text)
        }
        Event::Revoked { report, .. } => (
            report.last.0,
            MarkKind::Revoked,
            format!(
                "{} keyframes of the beginning were taken back: they had ridden on what moves",
                report.keyframes
            ),
        ),
        _ => return None,
    };
    Some(Mark { frame, kind, text })
}
