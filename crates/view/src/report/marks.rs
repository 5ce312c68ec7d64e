//! Notable events of a run.

use super::model::{Mark, MarkKind};
use stillpoint_slam::{Event, LoopOutcome, Outcome};

/// The mark of an event, if it has one. Losses are marked from the frames instead. Loops and revoked keyframes refer to keyframe ids, of
/// which the initial map has the first `known`.
pub(crate) fn mark_of(event: &Event, known: u32) -> Option<Mark> {
    let frame_of = |keyframe: u32| keyframe.saturating_sub(known);
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
            (frame_of(report.keyframe.0), MarkKind::Loop, text)
        }
        Event::Revoked { report, .. } => (
            frame_of(report.last.0),
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

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_map::{KeyframeId, Map};
    use stillpoint_slam::RevokeReport;

    #[test]
    fn keyframe_events_are_marked_at_their_frames() {
        let [first, last] = [1000, 1012].map(KeyframeId);
        let report = RevokeReport {
            first,
            last,
            map_version: 3,
            keyframes: 4,
        };
        let view = Map::new(8, 1.2).publish();
        let event = Event::Revoked { report, view };
        // The initial map had a thousand ids.
        assert_eq!(mark_of(&event, 1000).map(|m| m.frame), Some(12));
        assert_eq!(mark_of(&event, 0).map(|m| m.frame), Some(1012));
    }
}
