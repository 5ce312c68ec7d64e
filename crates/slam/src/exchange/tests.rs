//! Messages that the exchange takes and refuses.

use super::*;
use crate::config::Config;
use stillpoint_geometry::Camera;
use stillpoint_imaging::{DepthImage, GrayImage, Simd};

fn exchange() -> Exchange {
    let camera = Camera::pinhole(64, 48, [50.0, 50.0, 31.5, 23.5]);
    Exchange::from(Stages::new(Config::default(), camera, Simd::Scalar).unwrap())
}

fn frame(id: u32) -> Arc<RgbdFrame> {
    Arc::new(RgbdFrame {
        id: FrameId(id),
        stamp: f64::from(id),
        depth_stamp: f64::from(id),
        gray: GrayImage::new(64, 48),
        colour: None,
        depth: DepthImage::from_vec(64, 48, vec![0.0; 64 * 48]).unwrap(),
    })
}

#[test]
fn entries_without_a_message_are_refused_without_effect() {
    let mut exchange = exchange();
    let nobody = [
        LogEntry::TrackView { answer: 0 },
        LogEntry::TrackPlaces { answer: 0 },
        LogEntry::MapKeyframe {
            keyframe: KeyframeId(0),
        },
        LogEntry::MapCorrect { base_version: 1 },
        LogEntry::LoopCorrected { map_version: 1 },
        LogEntry::of_frame(&frame(3)),
    ];
    for entry in nobody {
        let refused = exchange.take(&entry, None).unwrap_err();
        assert_eq!((&*refused.expected, refused.found), (&entry, None));
    }
    // A frame other than the one named.
    let refused = exchange.take(&LogEntry::of_frame(&frame(3)), Some(&frame(4)));
    let found = refused.unwrap_err().found;
    assert_eq!(found.as_deref(), Some(&LogEntry::of_frame(&frame(4))));
    let event = exchange.take(&LogEntry::of_frame(&frame(3)), Some(&frame(3)));
    assert_eq!(
        event.unwrap().unwrap().as_frame().unwrap().report.frame.0,
        3
    );
}

#[test]
fn message_stays_queued_until_its_own_log_entry() {
    let mut exchange = exchange();
    let rejudge = |keyframe: u32| MapperMsg::Rejudge {
        keyframe: KeyframeId(keyframe),
        features: Vec::new(),
    };
    exchange.for_mapper.extend([rejudge(1), rejudge(2)]);
    let named = |k: u32| LogEntry::MapRejudge {
        keyframe: KeyframeId(k),
    };
    assert_eq!(exchange.next_for_mapper(), Some(named(1)));
    let refused = exchange.take(&named(2), None).unwrap_err();
    assert_eq!(refused.found.as_deref(), Some(&named(1)));
    assert_eq!(
        refused.to_string(),
        "expected MapRejudge { keyframe: KeyframeId(2) }, found MapRejudge { keyframe: KeyframeId(1) }"
    );
    for k in [1, 2] {
        let event = exchange.take(&named(k), None).unwrap();
        assert!(matches!(event, Some(Event::Rejudged { .. })));
    }
    // The report goes to the loop closer, the views to the tracker. Taking a view discards older ones.
    assert!(matches!(
        exchange.next_for_loop_closer(),
        Some(LogEntry::LoopRejudged { .. })
    ));
    assert_eq!(exchange.views_sent(), 2);
    assert!(
        exchange
            .take(&LogEntry::TrackView { answer: 1 }, None)
            .is_ok()
    );
    assert!(
        exchange
            .take(&LogEntry::TrackView { answer: 0 }, None)
            .is_err()
    );
}
