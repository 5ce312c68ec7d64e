//! Errors that others published, each with its source. Facts from tables, nothing else.

use serde::Serialize;

/// A system that errors were published for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum System {
    /// The publication that preset `paper` follows. It gives its system no name.
    Paper,
    OrbSlam2,
    DsSlam,
    RdsSlam,
    BlitzSlam,
    SgSlam,
    StaticFusion,
    ReFusion,
    YoloSlam,
}

impl System {
    /// In the order of their numbers.
    const ALL: [Self; 9] = [
        Self::Paper,
        Self::OrbSlam2,
        Self::DsSlam,
        Self::RdsSlam,
        Self::BlitzSlam,
        Self::SgSlam,
        Self::StaticFusion,
        Self::ReFusion,
        Self::YoloSlam,
    ];

    /// Its name in tables.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Paper => "published method",
            Self::OrbSlam2 => "ORB-SLAM2",
            Self::DsSlam => "DS-SLAM",
            Self::RdsSlam => "RDS-SLAM",
            Self::BlitzSlam => "Blitz-SLAM",
            Self::SgSlam => "SG-SLAM",
            Self::StaticFusion => "StaticFusion",
            Self::ReFusion => "ReFusion",
            Self::YoloSlam => "YOLO-SLAM",
        }
    }

    /// The publication that describes it.
    pub(crate) fn publication(self) -> &'static str {
        match self {
            Self::Paper => {
                "\"A real-time visual SLAM based on semantic information and geometric information in dynamic environment\", \
                 Journal of Real-Time Image Processing, 2024, doi:10.1007/s11554-024-01527-4"
            }
            Self::OrbSlam2 => {
                "Mur-Artal, Tardos, \"ORB-SLAM2: an open-source SLAM system for monocular, stereo, and RGB-D cameras\", \
                 IEEE Transactions on Robotics 33(5), 2017, doi:10.1109/TRO.2017.2705103"
            }
            Self::DsSlam => "Yu et al., DS-SLAM, IROS 2018",
            Self::RdsSlam => "Liu, Miura, RDS-SLAM, IEEE Access, 2021",
            Self::BlitzSlam => "Fan et al., Blitz-SLAM, Pattern Recognition, 2022",
            Self::SgSlam => {
                "Cheng et al., SG-SLAM, IEEE Transactions on Instrumentation and Measurement, 2023"
            }
            Self::StaticFusion => "Scona et al., StaticFusion, ICRA 2018",
            Self::ReFusion => "Palazzolo et al., ReFusion, IROS 2019",
            Self::YoloSlam => "Wu et al., YOLO-SLAM, Neural Computing and Applications, 2022",
        }
    }

    /// What stands for its publication in a text, e.g. `[1]`.
    pub(crate) fn mark(self) -> String {
        let number = Self::ALL.iter().position(|s| *s == self);
        format!("[{}]", number.unwrap_or(0) + 1)
    }
}

/// The list of sources below a table, as Markdown; `table` is where the figures stand in the first of them.
pub(crate) fn sources(systems: &[System], table: &str) -> String {
    let mut text = format!(
        "Published figures are those of {table} of {paper}, which quotes the other systems' own papers; none was measured on this \
         machine. {paper} says that its figures are the best of several runs. Ours are medians.\n\n",
        paper = System::Paper.mark()
    );
    for system in System::ALL.iter().filter(|s| systems.contains(s)) {
        text += &format!("- {} {}\n", system.mark(), system.publication());
    }
    text
}

/// ATE RMSE of a system on a sequence, m.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct PublishedAte {
    pub(crate) system: &'static str,
    pub(crate) ate_rmse: f64,
    pub(crate) source: &'static str,
}

/// ATE RMSE of several systems on several sequences, m.
#[derive(Debug)]
pub(crate) struct Errors {
    /// Where in the publication of preset `paper` they stand.
    pub(crate) table: &'static str,
    pub(crate) systems: [System; 6],
    rows: &'static [(&'static str, [f64; 6])],
}

impl Errors {
    /// ATE RMSE per system on a sequence, m; `None` where nothing was published on it, or not of that system.
    pub(crate) fn of(&self, sequence: &str) -> Option<[Option<f64>; 6]> {
        let row = self.rows.iter().find(|(name, _)| *name == sequence)?;
        Some(row.1.map(|ate| Some(ate).filter(|a| a.is_finite())))
    }

    /// The same as a list, for JSON.
    pub(crate) fn list(&self, sequence: &str) -> Vec<PublishedAte> {
        let ates = self.of(sequence).unwrap_or_default();
        let known = self.systems.iter().zip(ates);
        let known = known.filter_map(|(system, ate)| {
            Some(PublishedAte {
                system: system.name(),
                ate_rmse: ate?,
                source: system.publication(),
            })
        });
        known.collect()
    }

    /// What preset `paper`'s publication reached, m.
    pub(crate) fn paper(&self, sequence: &str) -> Option<f64> {
        self.of(sequence)?[5]
    }
}

/// Not given.
const NO: f64 = f64::NAN;

/// TUM RGB-D, camera freiburg3.
pub(crate) static TUM: Errors = Errors {
    table: "Table 1",
    systems: [
        System::OrbSlam2,
        System::DsSlam,
        System::RdsSlam,
        System::BlitzSlam,
        System::SgSlam,
        System::Paper,
    ],
    rows: &[
        (
            "walking_xyz",
            [0.9528, 0.0247, 0.0571, 0.0153, 0.0152, 0.0151],
        ),
        (
            "walking_static",
            [0.4116, 0.0081, 0.0206, 0.0102, 0.0073, 0.0072],
        ),
        (
            "walking_rpy",
            [1.1808, 0.4442, 0.1604, 0.0356, 0.0324, 0.0264],
        ),
        (
            "walking_halfsphere",
            [0.6917, 0.0303, 0.0807, 0.0256, 0.0268, 0.0258],
        ),
        (
            "sitting_static",
            [0.0082, 0.0065, 0.0084, NO, 0.0060, 0.0066],
        ),
    ],
};

/// Bonn RGB-D Dynamic.
pub(crate) static BONN: Errors = Errors {
    table: "Table 4",
    systems: [
        System::OrbSlam2,
        System::StaticFusion,
        System::ReFusion,
        System::YoloSlam,
        System::SgSlam,
        System::Paper,
    ],
    rows: &[
        ("crowd", [1.120, 3.586, 0.204, 0.033, 0.023, 0.019]),
        ("crowd2", [1.501, 0.215, 0.155, 0.423, 0.058, 0.025]),
        ("crowd3", [1.017, 0.168, 0.137, 0.069, 0.032, 0.031]),
        (
            "moving_nonobstructing_box",
            [0.317, 0.141, 0.071, 0.027, 0.019, 0.023],
        ),
        (
            "moving_nonobstructing_box2",
            [0.349, 0.364, 0.179, 0.035, 0.029, 0.029],
        ),
        (
            "person_tracking",
            [0.997, 0.484, 0.289, 0.157, 0.040, 0.038],
        ),
        (
            "person_tracking2",
            [1.107, 0.626, 0.463, 0.037, 0.037, 0.038],
        ),
        ("synchronous", [1.068, 0.446, 0.441, 0.014, 0.323, 0.013]),
        ("synchronous2", [1.168, 0.027, 0.022, 0.007, 0.016, 0.007]),
    ],
};

/// ATE RMSE of a published ablation, m.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Ablated {
    /// What it was measured on, without the camera.
    pub(crate) recording: &'static str,
    /// Nothing, objects, epipolar constraint, both, and both with depth.
    pub(crate) ate: [f64; 5],
}

/// Where [`ABLATED`] stands in the publication of preset `paper`.
pub(crate) const ABLATION_TABLE: &str = "Table 5";

/// All of the camera freiburg3 of TUM RGB-D.
#[rustfmt::skip]
pub(crate) const ABLATED: [Ablated; 5] = [
    Ablated { recording: "walking_xyz", ate: [0.9528, 0.0162, 0.3211, 0.0178, 0.0151] },
    Ablated { recording: "walking_static", ate: [0.4116, 0.0079, 0.0279, 0.0074, 0.0072] },
    Ablated { recording: "walking_rpy", ate: [1.1808, 0.0434, 0.7563, 0.0293, 0.0264] },
    Ablated { recording: "walking_halfsphere", ate: [0.6917, 0.0307, 0.1160, 0.0344, 0.0258] },
    Ablated { recording: "sitting_static", ate: [0.0082, 0.0086, 0.0078, 0.0081, 0.0066] },
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_figure_has_a_source_that_is_listed() {
        for errors in [&TUM, &BONN] {
            let text = sources(&errors.systems, errors.table);
            for (sequence, _) in errors.rows {
                for ate in errors.list(sequence) {
                    assert!(ate.ate_rmse > 0.0 && ate.ate_rmse < 4.0, "{ate:?}");
                    assert!(text.contains(ate.source), "{ate:?}");
                }
            }
            assert!(text.contains("best of several runs"), "{text}");
            assert_eq!(text.matches("\n- [").count(), 6, "{text}");
        }
        assert_eq!(TUM.list("sitting_static").len(), 5);
        assert_eq!(TUM.list("sitting_xyz"), []);
    }

    /// Without its parts the published system is ORB-SLAM2, with all of them it is the one of the other table.
    #[test]
    fn the_ablation_begins_and_ends_where_the_table_stands() {
        for ablated in ABLATED {
            let table = TUM.of(ablated.recording).unwrap();
            assert_eq!(table[0], Some(ablated.ate[0]), "{ablated:?}");
            assert_eq!(table[5], Some(ablated.ate[4]), "{ablated:?}");
        }
    }
}
