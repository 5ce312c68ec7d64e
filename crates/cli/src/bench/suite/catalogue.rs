//! The sequences of public data sets with moving people and things, and the errors that others published on them.

use clap::ValueEnum;
use serde::Serialize;

/// A public data set, as far as it is about things that move.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Suite {
    /// TUM RGB-D, dynamic objects: freiburg3 walking and sitting, freiburg2 desk with person
    TumDynamic,
    /// Bonn RGB-D Dynamic
    Bonn,
}

/// ATE RMSE that others published, m.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub(crate) struct Published {
    /// A system of the kind of this one: objects, epipolar geometry and depth; for Bonn, the usual point of comparison.
    pub(crate) reference: Option<f64>,
    /// The best RGB-D system, where one is better than the reference.
    pub(crate) best: Option<f64>,
    /// The reference with everything switched off that rejects moving things.
    pub(crate) unfiltered: Option<f64>,
}

impl Published {
    const NONE: Self = Self {
        reference: None,
        best: None,
        unfiltered: None,
    };

    const fn reference(ate: f64) -> Self {
        Self {
            reference: Some(ate),
            ..Self::NONE
        }
    }

    const fn best(mut self, ate: f64) -> Self {
        self.best = Some(ate);
        self
    }

    const fn unfiltered(mut self, ate: f64) -> Self {
        self.unfiltered = Some(ate);
        self
    }
}

/// One sequence of a suite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Known {
    /// The folder's name without what all of the camera have in common.
    pub(crate) name: &'static str,
    /// The camera's part of the folder's name, in all forms that are in use.
    pub(crate) camera: &'static [&'static str],
    pub(crate) published: Published,
    /// What a reader of the table should know.
    pub(crate) note: &'static str,
}

/// ATE RMSE of a published ablation, m.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Ablated {
    /// What it was measured on, without the camera.
    pub(crate) recording: &'static str,
    /// Nothing, objects, epipolar constraint, both, and both with depth.
    pub(crate) ate: [f64; 5],
}

/// All of the camera freiburg3 of TUM RGB-D.
#[rustfmt::skip]
const ABLATED: [Ablated; 5] = [
    Ablated { recording: "walking_xyz", ate: [0.9528, 0.0162, 0.3211, 0.0178, 0.0151] },
    Ablated { recording: "walking_static", ate: [0.4116, 0.0079, 0.0279, 0.0074, 0.0072] },
    Ablated { recording: "walking_rpy", ate: [1.1808, 0.0434, 0.7563, 0.0293, 0.0264] },
    Ablated { recording: "walking_halfsphere", ate: [0.6917, 0.0307, 0.1160, 0.0344, 0.0258] },
    Ablated { recording: "sitting_static", ate: [0.0082, 0.0086, 0.0078, 0.0081, 0.0066] },
];

/// The published ablation of the recording that a folder holds or a simulated scene is modelled on, by its name.
pub(crate) fn published_ablation(name: &str) -> Option<Ablated> {
    let known = Suite::TumDynamic.recognise(name).map(|k| k.name);
    let name = known.or(name.strip_prefix("sim:"))?;
    ABLATED.into_iter().find(|a| a.recording == name)
}

const FR2: &[&str] = &["freiburg2", "fr2"];
const FR3: &[&str] = &["freiburg3", "fr3"];
const BONN: &[&str] = &["bonn"];

const fn known(camera: &'static [&'static str], name: &'static str, published: Published) -> Known {
    Known {
        name,
        camera,
        published,
        note: "",
    }
}

const fn figure(ate: f64) -> Published {
    Published::reference(ate)
}

#[rustfmt::skip]
const TUM_DYNAMIC: &[Known] = &[
    known(FR3, "walking_xyz", figure(0.0151).best(0.013).unfiltered(0.9528)),
    known(FR3, "walking_static", figure(0.0072).best(0.005).unfiltered(0.4116)),
    known(FR3, "walking_rpy", figure(0.0264).unfiltered(1.1808)),
    known(FR3, "walking_halfsphere", figure(0.0258).best(0.016).unfiltered(0.6917)),
    known(FR3, "sitting_static", figure(0.0066).best(0.005).unfiltered(0.0082)),
    known(FR3, "sitting_xyz", figure(0.009)),
    known(FR3, "sitting_rpy", figure(0.0195)),
    known(FR3, "sitting_halfsphere", figure(0.0147).best(0.013)),
    known(FR2, "desk_with_person", Published::NONE),
];

#[rustfmt::skip]
const BONN_DYNAMIC: &[Known] = &[
    known(BONN, "balloon", Published::NONE),
    known(BONN, "balloon2", Published::NONE),
    known(BONN, "balloon_tracking", Published::NONE),
    known(BONN, "balloon_tracking2", Published::NONE),
    known(BONN, "crowd", figure(0.019).best(0.016)),
    known(BONN, "crowd2", figure(0.025).best(0.023)),
    known(BONN, "crowd3", figure(0.031).best(0.023)),
    known(BONN, "kidnapping_box", Published::NONE),
    known(BONN, "kidnapping_box2", Published::NONE),
    known(BONN, "moving_nonobstructing_box", figure(0.023).best(0.016)),
    known(BONN, "moving_nonobstructing_box2", figure(0.029).best(0.021)),
    Known {
        note: "unsolved: no published system is under 250 mm",
        ..known(BONN, "moving_obstructing_box", Published::NONE)
    },
    known(BONN, "moving_obstructing_box2", Published::NONE),
    known(BONN, "person_tracking", figure(0.038).best(0.024)),
    known(BONN, "person_tracking2", figure(0.038).best(0.036)),
    known(BONN, "placing_nonobstructing_box", Published::NONE),
    known(BONN, "placing_nonobstructing_box2", Published::NONE),
    known(BONN, "placing_nonobstructing_box3", Published::NONE),
    known(BONN, "placing_obstructing_box", Published::NONE),
    known(BONN, "removing_nonobstructing_box", Published::NONE),
    known(BONN, "removing_nonobstructing_box2", Published::NONE),
    known(BONN, "removing_obstructing_box", Published::NONE),
    known(BONN, "static", Published::NONE),
    known(BONN, "static_close_far", Published::NONE),
    known(BONN, "synchronous", figure(0.013)),
    known(BONN, "synchronous2", figure(0.007)),
];

impl Suite {
    /// The name, as the option takes it.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::TumDynamic => "tum-dynamic",
            Self::Bonn => "bonn",
        }
    }

    /// All sequences, in the order of the report.
    pub(crate) fn sequences(self) -> &'static [Known] {
        match self {
            Self::TumDynamic => TUM_DYNAMIC,
            Self::Bonn => BONN_DYNAMIC,
        }
    }

    /// A folder's name, as an example of what is looked for.
    pub(crate) fn example(self) -> &'static str {
        match self {
            Self::TumDynamic => "rgbd_dataset_freiburg3_walking_xyz",
            Self::Bonn => "rgbd_bonn_crowd",
        }
    }

    /// The sequence that a folder of this name holds. Upper case, `-` for `_`, and `fr3` for `freiburg3` are accepted; the
    /// camera must be in the name, because a folder `static` could be anything.
    pub(crate) fn recognise(self, folder: &str) -> Option<&'static Known> {
        let folder = folder.to_lowercase().replace('-', "_");
        let rest = ["rgbd_dataset_", "rgbd_"]
            .iter()
            .find_map(|p| folder.strip_prefix(p))
            .unwrap_or(&folder);
        self.sequences().iter().find(|known| {
            known.camera.iter().any(|camera| {
                rest.strip_prefix(camera)
                    .and_then(|r| r.strip_prefix('_'))
                    .is_some_and(|name| name == known.name)
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn name(suite: Suite, folder: &str) -> Option<&'static str> {
        suite.recognise(folder).map(|k| k.name)
    }

    #[test]
    fn folders_are_known_by_their_names() {
        for (folder, expected) in [
            ("rgbd_dataset_freiburg3_walking_xyz", Some("walking_xyz")),
            ("RGBD_dataset_freiburg3_walking-xyz", Some("walking_xyz")),
            ("fr3_sitting_rpy", Some("sitting_rpy")),
            ("freiburg2_desk_with_person", Some("desk_with_person")),
            ("rgbd_dataset_freiburg3_walking_xyz_validation", None),
            ("rgbd_dataset_freiburg2_walking_xyz", None),
            ("walking_xyz", None),
            ("rgbd_bonn_crowd", None),
        ] {
            assert_eq!(name(Suite::TumDynamic, folder), expected, "{folder}");
        }
        for (folder, expected) in [
            ("rgbd_bonn_crowd", Some("crowd")),
            ("rgbd_bonn_crowd2", Some("crowd2")),
            ("bonn_static", Some("static")),
            ("rgbd_bonn_crowd22", None),
            ("static", None),
            ("rgbd_dataset_freiburg3_walking_xyz", None),
        ] {
            assert_eq!(name(Suite::Bonn, folder), expected, "{folder}");
        }
        for suite in [Suite::TumDynamic, Suite::Bonn] {
            assert!(suite.recognise(suite.example()).is_some());
        }
    }

    #[test]
    fn every_sequence_is_listed_once_and_the_best_is_better() {
        for suite in [Suite::TumDynamic, Suite::Bonn] {
            let all = suite.sequences();
            for (i, known) in all.iter().enumerate() {
                assert!(all[..i].iter().all(|k| k.name != known.name), "{known:?}");
                let p = known.published;
                if let (Some(best), Some(reference)) = (p.best, p.reference) {
                    assert!(best < reference, "{known:?}");
                }
                if let (Some(reference), Some(unfiltered)) = (p.reference, p.unfiltered) {
                    assert!(reference < unfiltered, "{known:?}");
                }
            }
        }
        assert_eq!(Suite::TumDynamic.sequences().len(), 9);
        assert_eq!(Suite::Bonn.sequences().len(), 26);
    }

    #[test]
    fn the_ablation_ends_where_the_table_stands() {
        for known in Suite::TumDynamic.sequences() {
            let folder = format!("rgbd_dataset_freiburg3_{}", known.name);
            let ablated = published_ablation(&folder);
            assert_eq!(ablated, published_ablation(&format!("sim:{}", known.name)));
            let [none, .., all] = ablated.map_or([f64::NAN; 5], |a| a.ate);
            let p = known.published;
            assert_eq!(p.unfiltered.is_some(), ablated.is_some(), "{known:?}");
            assert!(p.unfiltered.is_none_or(|x| x == none), "{known:?}");
            assert!(ablated.is_none() || p.reference == Some(all), "{known:?}");
        }
        assert_eq!(published_ablation("walking_xyz"), None);
        assert_eq!(published_ablation("sim:xyz"), None);
    }
}
