use super::*;
use proptest::prelude::*;

const REASONS: [LostReason; 4] = [
    LostReason::FewFeatures,
    LostReason::FewDepths,
    LostReason::FewMatches,
    LostReason::FewInliers,
];

const FINE: Look = Look {
    mean: 120.0,
    contrast: 50.0,
    depth: 0.8,
};

fn counts() -> impl Strategy<Value = FrameCounts> {
    prop::array::uniform5(0..1000_u32).prop_map(|[keypoints, with_depth, a, b, c]| FrameCounts {
        keypoints,
        with_depth,
        frame_matches: a,
        map_matches: b,
        inliers: c,
        ..FrameCounts::default()
    })
}

fn line(cause: LossCause, seconds: f64, can_recognise: bool) -> String {
    let since = FrameId(0);
    let reason = LostReason::FewMatches;
    Loss {
        since,
        seconds,
        reason,
        cause,
        can_recognise,
    }
    .to_string()
}

fn without_numbers(text: &str) -> String {
    text.chars().filter(|c| !c.is_ascii_digit()).collect()
}

proptest! {
    /// Every cause has its own text, one line without surrounding blanks.
    #[test]
    fn loss_causes_have_distinct_texts_and_remedies(counts in counts(), moving in 0.5..1.0f64, needed in 10..1000_u32, seconds in 0.0..1e4f64, map in any::<bool>()) {
        let dark = Look { mean: 3.0, contrast: 1.0, depth: 0.0 };
        let white = Look { mean: 254.0, contrast: 1.0, depth: 0.5 };
        let flat = Look { depth: 0.0, ..FINE };
        let of = |reason, look, moving| cause(&Clues { reason, counts: &counts, look, moving, needed });
        let mut all: Vec<LossCause> = REASONS.iter().map(|r| of(*r, FINE, 0.0)).collect();
        all.push(of(LostReason::FewFeatures, dark, 0.0));
        all.push(of(LostReason::FewFeatures, white, 0.0));
        all.push(of(LostReason::FewDepths, flat, 0.0));
        all.push(of(LostReason::FewInliers, FINE, moving));
        let lines: Vec<String> = all.iter().map(|c| line(*c, seconds, map)).collect();
        for (i, a) in lines.iter().enumerate() {
            prop_assert!(!a.contains('\n') && a.trim() == a && a.starts_with("lost for "), "{a}");
            for b in &lines[..i] {
                prop_assert_ne!(without_numbers(a), without_numbers(b));
            }
            let remedies = all.iter().filter(|c| c.remedy() == all[i].remedy()).count();
            prop_assert_eq!(remedies, 1);
        }
    }

    /// The reported figures are those of the frame.
    #[test]
    fn loss_text_contains_counts_and_thresholds(counts in counts(), needed in 10..1000_u32) {
        let of = |reason| cause(&Clues { reason, counts: &counts, look: FINE, moving: 0.0, needed }).to_string();
        let reported = [counts.keypoints, counts.with_depth, counts.frame_matches, counts.inliers];
        for (reason, count) in REASONS.iter().zip(reported) {
            let text = of(*reason);
            prop_assert!(text.contains(&count.to_string()), "{text}");
            prop_assert!(text.contains(&needed.to_string()), "{text}");
        }
    }

    /// A black or white image is the cause, whichever tracking step failed.
    #[test]
    fn dark_or_dazzled_image_takes_precedence_as_cause(counts in counts(), reason in prop::sample::select(&REASONS[..]), level in 0..256_u32, moving in 0.0..1.0f64) {
        let look = Look { mean: f64::from(level), contrast: 2.0, depth: 0.5 };
        let found = cause(&Clues { reason, counts: &counts, look, moving, needed: 30 });
        prop_assert_eq!(matches!(found, LossCause::Dark { .. }), f64::from(level) < BLACK);
        prop_assert_eq!(matches!(found, LossCause::Dazzled { .. }), f64::from(level) > 255.0 - BLACK);
    }
}

#[test]
fn loss_lines_match_the_documentation() {
    let dark = LossCause::Dark {
        keypoints: 3,
        needed: 30,
    };
    assert_eq!(
        line(dark, 1.24, true),
        "lost for 1.2 s: the image is black or covered (3 keypoints; 30 needed); uncover the lens or make light, and show it a place that it has seen"
    );
    let nothing = LossCause::NoDepth { pixels: 0.021 };
    assert_eq!(
        line(nothing, 0.0, false),
        "lost for 0.0 s: no depth: 2 % of the pixels have one; check the depth sensor and its range"
    );
    let crowd = LossCause::Crowd { moving: 0.93 };
    assert_eq!(
        line(crowd, 2.0, false),
        "lost for 2.0 s: people or things that move fill the image: 93 % of the keypoints are on them; let them pass or turn the camera away from them"
    );
    let unknown = LossCause::Unknown {
        matches: 4,
        needed: 30,
    };
    assert_eq!(
        line(unknown, 61.0, true),
        "lost for 61.0 s: what is seen is not known (4 matches; 30 needed); go back to a place that it has seen"
    );
}
