//! Configuration of the extractor.

use serde::{Deserialize, Serialize};

/// Configuration of [`crate::OrbExtractor`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OrbConfig {
    /// Keypoints per image, 100..=10000. 1000 is common in comparable systems at 640x480: fewer lose accuracy, more
    /// cost time in every later stage.
    pub features: usize,
    /// Pyramid levels, 1..=16. Five levels of 1.45 cover a change of distance by 4.4; the eight of 1.2 of ORB-SLAM2
    /// cover 3.6, take half as long again to extract, and give errors 1.02 times as large (decision 60).
    pub levels: usize,
    /// Scale factor between levels, above 1 up to 2. A corner of any scale is at most half a level from the next one:
    /// with 1.45 its patch differs by 20 % in size.
    pub scale_factor: f32,
    /// FAST threshold, grey levels, 1..=254: how much brighter or darker than the centre the arc must be. 20 is above
    /// sensor noise (ORB-SLAM2, Mur-Artal, Tardos 2017).
    pub fast_threshold: u8,
    /// FAST threshold in cells of about 32 px where the other finds nothing, 1..=`fast_threshold`. With 7, as in
    /// ORB-SLAM2, a room has too few corners beside a person in patterned clothes; 5 and 6 suffice (decision 65).
    pub fast_threshold_low: u8,
    /// Whether to refine corner positions to subpixel accuracy. On real frames 0.1 s apart this reduces the median
    /// distance of matches to their epipolar lines by a third.
    pub subpixel: bool,
}

impl Default for OrbConfig {
    fn default() -> Self {
        // As in ORB-SLAM2's RGB-D settings (Mur-Artal, Tardos 2017), except for the levels, the lower threshold and the
        // subpixel refinement.
        Self {
            features: 1000,
            levels: 5,
            scale_factor: 1.45,
            fast_threshold: 20,
            fast_threshold_low: 5,
            subpixel: true,
        }
    }
}

impl OrbConfig {
    /// Every value out of range, as `field: expected, found`.
    #[must_use]
    pub fn problems(&self) -> Vec<String> {
        let mut problems = Vec::new();
        let mut check = |ok: bool, field: &str, expected: &str, found: String| {
            if !ok {
                problems.push(format!("{field}: expected {expected}, found {found}"));
            }
        };
        let (low, high) = (self.fast_threshold_low, self.fast_threshold);
        check(
            (100..=10_000).contains(&self.features),
            "features",
            "100 to 10000",
            self.features.to_string(),
        );
        check(
            (1..=16).contains(&self.levels),
            "levels",
            "1 to 16",
            self.levels.to_string(),
        );
        check(
            self.scale_factor > 1.0 && self.scale_factor <= 2.0,
            "scale_factor",
            "above 1, at most 2",
            self.scale_factor.to_string(),
        );
        check(
            (1..=254).contains(&high),
            "fast_threshold",
            "1 to 254",
            high.to_string(),
        );
        check(
            (1..=high).contains(&low),
            "fast_threshold_low",
            "1 to fast_threshold",
            low.to_string(),
        );
        problems
    }
}
