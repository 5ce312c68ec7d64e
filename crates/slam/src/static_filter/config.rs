//! Configuration of the static filter.

use crate::sensor::DepthNoise;
use crate::validation::Checker;
use serde::{Deserialize, Serialize};
use stillpoint_detection::{MotionWeights, ObjectsConfig};

/// Strategy for rejecting features.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Preset {
    /// Every feature counts as static.
    Off,
    /// Objects, epipolar constraint and depth, fused as published.
    Paper,
    /// Log odds per depth-connected region from objects, free space, flow and the past.
    #[default]
    Default,
}

/// Parts of the static filter: as text the letters O, G and D, joined by `+`, or `none`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct FilterParts {
    pub(crate) objects: bool,
    pub(crate) geometry: bool,
    pub(crate) depth: bool,
}

impl Default for FilterParts {
    /// All parts.
    fn default() -> Self {
        Self {
            objects: true,
            geometry: true,
            depth: true,
        }
    }
}

impl From<FilterParts> for String {
    fn from(parts: FilterParts) -> Self {
        let letters = [
            (parts.objects, "O"),
            (parts.geometry, "G"),
            (parts.depth, "D"),
        ];
        let used: Vec<&str> = letters.iter().filter(|l| l.0).map(|l| l.1).collect();
        if used.is_empty() {
            "none".to_owned()
        } else {
            used.join("+")
        }
    }
}

impl TryFrom<String> for FilterParts {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let mut parts = Self {
            objects: false,
            geometry: false,
            depth: false,
        };
        if text == "none" {
            return Ok(parts);
        }
        for letter in text.split('+') {
            match letter.trim() {
                "O" => parts.objects = true,
                "G" => parts.geometry = true,
                "D" => parts.depth = true,
                other => {
                    return Err(format!(
                        "expected letters of \"O+G+D\" joined by \"+\", or \"none\", found \"{other}\""
                    ));
                }
            }
        }
        Ok(parts)
    }
}

/// Rejection of moving objects.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StaticFilterConfig {
    /// Strategy: "off", "paper" (objects, epipolar constraint and depth as published) or "default".
    pub preset: Preset,
    /// Parts that are used, for ablations: objects (O), flow between frames (G: the epipolar constraint, and in preset
    /// "default" the rigid test), depth within boxes (D: in preset "paper" splits a box into object and background, in
    /// preset "default" gives an object a range of depth, without which everything in its box belongs to it). Range:
    /// letters of "O+G+D" joined by "+", or "none".
    pub parts: FilterParts,
    /// Minimum number of static features; with fewer, the least risky dynamic ones are used as well. Range: 0 to 1000.
    pub min_features: usize,
    /// Distance from its epipolar line from which a feature moves, px; inside a box the distance is multiplied by the
    /// motion weight. In preset "paper". Range: 0.1 to 20. 1 as published.
    pub epipolar_px: f64,
    /// Boxes of classes of at least this motion weight are split by depth. In preset "paper". Range: 0 to 5. 3 splits
    /// those of people and chairs, and not those of desks.
    pub split_weight: f64,
}

impl Default for StaticFilterConfig {
    fn default() -> Self {
        Self {
            preset: Preset::Default,
            parts: FilterParts::default(),
            min_features: 80,
            epipolar_px: 1.0,
            split_weight: 3.0,
        }
    }
}

impl StaticFilterConfig {
    pub(crate) fn check(&self, c: &mut Checker<'_>) {
        c.range("min_features", self.min_features as f64, 0.0, 1000.0);
        c.range("epipolar_px", self.epipolar_px, 0.1, 20.0);
        c.range("split_weight", self.split_weight, 0.0, 5.0);
    }
}

/// Settings of the static filter, made from a [`Config`](crate::Config).
#[derive(Clone, Debug, PartialEq)]
pub struct FilterSetup {
    /// Strategy and parts.
    pub filter: StaticFilterConfig,
    /// How likely each class is to move.
    pub weights: MotionWeights,
    /// Object tracking.
    pub objects: ObjectsConfig,
    /// Noise of the depth sensor.
    pub noise: DepthNoise,
    /// Seed of all random choices.
    pub seed: u64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn out_of_range_values_are_refused() {
        let problems = |f: &dyn Fn(&mut StaticFilterConfig)| {
            let mut config = StaticFilterConfig::default();
            f(&mut config);
            let mut problems = Vec::new();
            config.check(&mut Checker {
                section: "static_filter",
                problems: &mut problems,
            });
            problems.iter().map(ToString::to_string).collect::<String>()
        };
        assert_eq!(problems(&|_| ()), "");
        for (value, valid) in [
            (0.1, true),
            (20.0, true),
            (0.09, false),
            (21.0, false),
            (f64::NAN, false),
        ] {
            let said = problems(&|c| c.epipolar_px = value);
            assert_eq!(said.is_empty(), valid, "{said}");
            assert!(valid || said.contains("static_filter.epipolar_px: expected 0.1 to 20"));
        }
        for (value, valid) in [(0.0, true), (5.0, true), (-0.1, false), (5.1, false)] {
            let said = problems(&|c| c.split_weight = value);
            assert_eq!(said.is_empty(), valid, "{said}");
            assert!(valid || said.contains("static_filter.split_weight: expected 0 to 5"));
        }
        for (value, valid) in [(0, true), (1000, true), (1001, false)] {
            let said = problems(&|c| c.min_features = value);
            assert_eq!(said.is_empty(), valid, "{said}");
        }
    }

    #[test]
    fn filter_parts_round_trip() {
        for text in ["O+G+D", "O", "G", "D", "O+G", "O+D", "G+D", "none"] {
            let parts = FilterParts::try_from(text.to_owned());
            assert_eq!(parts.map(String::from), Ok(text.to_owned()));
        }
        for text in ["", "O+", "X", "OG", "o"] {
            let said = FilterParts::try_from(text.to_owned()).err();
            assert!(said.is_some_and(|s| s.contains("O+G+D")), "{text}");
        }
        assert_eq!(
            FilterParts::try_from("O+G+D".to_owned()),
            Ok(FilterParts::default())
        );
    }
}
