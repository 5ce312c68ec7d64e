//! The sequences of public data sets with moving people and things.

pub(crate) use crate::args::suite::Suite;
use crate::bench::suite::published::{
    ABLATED, Ablated, BONN as BONN_ERRORS, Errors, TUM as TUM_ERRORS,
};

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Known {
    /// The folder's name without the camera's prefix.
    pub(crate) name: &'static str,
    /// The camera's prefix, in all forms that are in use.
    pub(crate) camera: &'static [&'static str],
}

/// The published ablation of the recording that a folder holds or a simulated scene is modelled on, by its name.
pub(crate) fn published_ablation(name: &str) -> Option<Ablated> {
    let known = Suite::TumDynamic.recognise(name).map(|k| k.name);
    let name = known.or(name.strip_prefix("sim:"))?;
    ABLATED.into_iter().find(|a| a.recording == name)
}

const FR2: &[&str] = &["freiburg2", "fr2"];
const FR3: &[&str] = &["freiburg3", "fr3"];
const BONN: &[&str] = &["bonn"];

const fn known(camera: &'static [&'static str], name: &'static str) -> Known {
    Known { name, camera }
}

#[rustfmt::skip]
const TUM_DYNAMIC: &[Known] = &[
    known(FR3, "walking_xyz"),
    known(FR3, "walking_static"),
    known(FR3, "walking_rpy"),
    known(FR3, "walking_halfsphere"),
    known(FR3, "sitting_static"),
    known(FR3, "sitting_xyz"),
    known(FR3, "sitting_rpy"),
    known(FR3, "sitting_halfsphere"),
    known(FR2, "desk_with_person"),
];

#[rustfmt::skip]
const BONN_DYNAMIC: &[Known] = &[
    known(BONN, "balloon"),
    known(BONN, "balloon2"),
    known(BONN, "balloon_tracking"),
    known(BONN, "balloon_tracking2"),
    known(BONN, "crowd"),
    known(BONN, "crowd2"),
    known(BONN, "crowd3"),
    known(BONN, "kidnapping_box"),
    known(BONN, "kidnapping_box2"),
    known(BONN, "moving_nonobstructing_box"),
    known(BONN, "moving_nonobstructing_box2"),
    known(BONN, "moving_obstructing_box"),
    known(BONN, "moving_obstructing_box2"),
    known(BONN, "person_tracking"),
    known(BONN, "person_tracking2"),
    known(BONN, "placing_nonobstructing_box"),
    known(BONN, "placing_nonobstructing_box2"),
    known(BONN, "placing_nonobstructing_box3"),
    known(BONN, "placing_obstructing_box"),
    known(BONN, "removing_nonobstructing_box"),
    known(BONN, "removing_nonobstructing_box2"),
    known(BONN, "removing_obstructing_box"),
    known(BONN, "static"),
    known(BONN, "static_close_far"),
    known(BONN, "synchronous"),
    known(BONN, "synchronous2"),
];

impl Suite {
    pub(crate) fn sequences(self) -> &'static [Known] {
        match self {
            Self::TumDynamic => TUM_DYNAMIC,
            Self::Bonn => BONN_DYNAMIC,
        }
    }

    /// Cameras to run with where the user names none: for Bonn's depth there are two factors, the published one and the one that the scale
    /// of its published marker transform suggests.
    pub(crate) fn cameras(self) -> &'static [Option<&'static str>] {
        match self {
            Self::TumDynamic => &[None],
            Self::Bonn => &[Some("bonn"), Some("bonn_calibrated")],
        }
    }

    /// Published errors on its sequences.
    pub(crate) fn published(self) -> &'static Errors {
        match self {
            Self::TumDynamic => &TUM_ERRORS,
            Self::Bonn => &BONN_ERRORS,
        }
    }

    pub(crate) fn example(self) -> &'static str {
        match self {
            Self::TumDynamic => "rgbd_dataset_freiburg3_walking_xyz",
            Self::Bonn => "rgbd_bonn_crowd",
        }
    }

    /// The sequence that a folder of this name holds. Upper case, `-` for `_`, and `fr3` for `freiburg3` are accepted; the camera must be
    /// in the name, because a folder `static` could be anything.
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
    fn sequences_are_recognised_by_folder_name() {
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
    fn catalogue_lists_every_sequence_once() {
        for suite in [Suite::TumDynamic, Suite::Bonn] {
            let all = suite.sequences();
            for (i, known) in all.iter().enumerate() {
                assert!(all[..i].iter().all(|k| k.name != known.name), "{known:?}");
            }
        }
        assert_eq!(Suite::TumDynamic.sequences().len(), 9);
        assert_eq!(Suite::Bonn.sequences().len(), 26);
        let with_figures = |s: Suite| {
            let known = s.sequences().iter();
            known
                .filter(|k| !s.published().of(k.name).is_empty())
                .count()
        };
        // Every published sequence is in the suite.
        assert_eq!(with_figures(Suite::TumDynamic), 5);
        assert_eq!(with_figures(Suite::Bonn), 9);
    }

    #[test]
    fn published_ablation_is_found_by_folder_and_scene() {
        for known in Suite::TumDynamic.sequences() {
            let ablated = published_ablation(&format!("rgbd_dataset_freiburg3_{}", known.name));
            assert_eq!(ablated, published_ablation(&format!("sim:{}", known.name)));
            let published = Suite::TumDynamic.published().of(known.name);
            assert_eq!(ablated.is_none(), published.is_empty(), "{known:?}");
        }
        assert_eq!(published_ablation("walking_xyz"), None);
        assert_eq!(published_ablation("sim:xyz"), None);
    }
}
