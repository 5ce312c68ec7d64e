//! Published errors of other systems, each with its source.

use serde::Serialize;

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

    /// Time per frame from Table 6 of [1], ms, each with its machine.
    fn times(self) -> &'static [(f64, &'static str)] {
        match self {
            Self::Paper => &[(37.25, "i5-8400"), (103.5, "Jetson Xavier NX")],
            Self::OrbSlam2 => &[(32.50, "i5-8400"), (94.76, "Jetson Xavier NX")],
            Self::DsSlam => &[(76.46, "i7, P4000")],
            Self::RdsSlam => &[(206.13, "RTX 2080 Ti")],
            Self::BlitzSlam => &[(81.0, "i5-6500")],
            Self::YoloSlam => &[(696.09, "i5-4288U")],
            Self::SgSlam | Self::StaticFusion | Self::ReFusion => &[],
        }
    }

    /// Reference mark of its publication, e.g. `[1]`.
    pub(crate) fn mark(self) -> String {
        let number = Self::ALL.iter().position(|s| *s == self);
        format!("[{}]", number.unwrap_or(0) + 1)
    }
}

/// The list of sources below a table, as Markdown; `tables` locates the figures in the first of them.
pub(crate) fn sources(systems: &[System], tables: &str) -> String {
    let mut text = format!(
        "Published figures are those of {tables} of {paper}, which quotes the other systems' own papers; none was measured on this \
         machine. {paper} averages its times over ten runs and does not say how many runs its errors are of. Ours are medians over the seeds.\n\n",
        paper = System::Paper.mark()
    );
    for system in System::ALL.iter().filter(|s| systems.contains(s)) {
        text += &format!("- {} {}\n", system.mark(), system.publication());
    }
    text
}

/// A published error: RMSE, and standard deviation where it is given.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Figure {
    pub(crate) rmse: f64,
    pub(crate) sd: Option<f64>,
    /// Table in the publication of preset `paper`.
    pub(crate) table: &'static str,
}

/// Published figures of a system.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Published {
    pub(crate) system: &'static str,
    /// Absolute error, m.
    pub(crate) ate: Option<Figure>,
    /// Relative error over 1 s, m.
    pub(crate) rpe_translation: Option<Figure>,
    /// Relative error over 1 s, degrees.
    pub(crate) rpe_rotation_deg: Option<Figure>,
    /// Time per frame, ms, with the machine.
    pub(crate) ms_per_frame: &'static [(f64, &'static str)],
    /// The system's own publication, as cited in that of preset `paper`.
    pub(crate) source: &'static str,
    #[serde(skip)]
    pub(crate) mark: String,
}

/// RMSE and standard deviation of several systems on several sequences.
#[derive(Debug)]
pub(crate) struct Table {
    /// Table in the publication of preset `paper`.
    name: &'static str,
    systems: &'static [System],
    rows: &'static [(&'static str, &'static [[f64; 2]])],
}

impl Table {
    fn of(&self, sequence: &str, system: System) -> Option<Figure> {
        let row = self.rows.iter().find(|(name, _)| *name == sequence)?;
        let column = self.systems.iter().position(|s| *s == system)?;
        let [rmse, sd] = *row.1.get(column)?;
        let given = |x: f64| Some(x).filter(|x| x.is_finite());
        Some(Figure {
            rmse: given(rmse)?,
            sd: given(sd),
            table: self.name,
        })
    }
}

#[derive(Debug)]
pub(crate) struct Errors {
    pub(crate) tables: &'static str,
    ate: &'static Table,
    rpe: Option<[&'static Table; 2]>,
}

impl Errors {
    pub(crate) fn systems(&self) -> &'static [System] {
        self.ate.systems
    }

    /// Published errors on a sequence, a row per system; may be empty.
    pub(crate) fn of(&self, sequence: &str) -> Vec<Published> {
        let row = |system: &System| {
            let ate = self.ate.of(sequence, *system);
            let [translation, rotation] = match self.rpe {
                Some(tables) => tables.map(|t| t.of(sequence, *system)),
                None => [None, None],
            };
            ate.or(translation)?;
            Some(Published {
                system: system.name(),
                ate,
                rpe_translation: translation,
                rpe_rotation_deg: rotation,
                ms_per_frame: system.times(),
                source: system.publication(),
                mark: system.mark(),
            })
        };
        self.systems().iter().filter_map(row).collect()
    }
}

const NAN: f64 = f64::NAN;
const NO: [f64; 2] = [NAN, NAN];

pub(crate) static TUM: Errors = Errors {
    tables: "Tables 1 to 3 (errors) and 6 (times)",
    ate: &TUM_ATE,
    rpe: Some([&TUM_RPE_TRANSLATION, &TUM_RPE_ROTATION]),
};

pub(crate) static BONN: Errors = Errors {
    tables: "Tables 4 (errors) and 6 (times)",
    ate: &BONN_ATE,
    rpe: None,
};

/// ATE on TUM RGB-D, camera freiburg3, m.
#[rustfmt::skip]
static TUM_ATE: Table = Table {
    name: "Table 1",
    systems: &[System::OrbSlam2, System::DsSlam, System::RdsSlam, System::BlitzSlam, System::SgSlam, System::Paper],
    rows: &[
        ("walking_xyz", &[[0.9528, 0.5604], [0.0247, 0.0161], [0.0571, 0.0229], [0.0153, 0.0078], [0.0152, 0.0075], [0.0151, 0.0074]]),
        ("walking_static", &[[0.4116, 0.1876], [0.0081, 0.0036], [0.0206, 0.0120], [0.0102, 0.0052], [0.0073, 0.0034], [0.0072, 0.0032]]),
        ("walking_rpy", &[[1.1808, 0.5958], [0.4442, 0.2350], [0.1604, 0.0873], [0.0356, 0.0220], [0.0324, 0.0187], [0.0264, 0.0143]]),
        ("walking_halfsphere", &[[0.6917, 0.4120], [0.0303, 0.0159], [0.0807, 0.0454], [0.0256, 0.0126], [0.0268, 0.0134], [0.0258, 0.0134]]),
        ("sitting_static", &[[0.0082, 0.0041], [0.0065, 0.0033], [0.0084, 0.0043], NO, [0.0060, 0.0029], [0.0066, 0.0031]]),
    ],
};

/// RPE over 1 s on TUM RGB-D, translation, m/s.
#[rustfmt::skip]
static TUM_RPE_TRANSLATION: Table = Table {
    name: "Table 2",
    systems: &[System::OrbSlam2, System::DsSlam, System::RdsSlam, System::BlitzSlam, System::SgSlam, System::Paper],
    rows: &[
        ("walking_xyz", &[[0.4864, 0.3131], [0.0333, 0.0229], [0.0426, 0.0317], [0.0197, 0.0096], [0.0194, 0.0100], [0.0205, 0.0108]]),
        ("walking_static", &[[0.2731, 0.2380], [0.0102, 0.0048], [0.0221, 0.0149], [0.0129, 0.0069], [0.0100, 0.0051], [0.0095, 0.0042]]),
        ("walking_rpy", &[[0.4503, 0.3288], [0.1503, 0.1168], [0.1320, 0.1067], [0.0473, 0.0283], [0.0450, 0.0262], [0.0368, 0.0197]]),
        ("walking_halfsphere", &[[0.4082, 0.3131], [0.0297, 0.0152], [0.0482, 0.0360], [0.0253, 0.0123], [0.0279, 0.0146], [0.0262, 0.0121]]),
        ("sitting_static", &[[0.0092, 0.0046], [0.0078, 0.0038], [0.0123, 0.0070], NO, [0.0075, 0.0035], [0.0085, 0.0037]]),
    ],
};

/// RPE over 1 s on TUM RGB-D, rotation, deg/s.
#[rustfmt::skip]
static TUM_RPE_ROTATION: Table = Table {
    name: "Table 3",
    systems: &[System::OrbSlam2, System::DsSlam, System::RdsSlam, System::BlitzSlam, System::SgSlam, System::Paper],
    rows: &[
        ("walking_xyz", &[[9.5312, 6.1544], [0.8266, 0.5826], [0.9222, 0.6509], [0.6132, 0.3348], [0.5040, 0.2469], [0.6225, 0.3877]]),
        ("walking_static", &[[4.5227, 3.9107], [0.2690, 0.1182], [0.4944, 0.3112], [0.3038, 0.1437], [0.2676, 0.1144], [0.2633, 0.1134]]),
        ("walking_rpy", &[[8.8086, 6.4082], [3.0042, 2.3065], [13.1693, 12.0103], [1.0841, 0.6668], [0.9565, 0.5487], [0.8593, 0.4856]]),
        ("walking_halfsphere", &[[8.5589, 6.5261], [0.8142, 0.4101], [1.8828, 1.5250], [0.7879, 0.3751], [0.8119, 0.3878], [0.7357, 0.3533]]),
        ("sitting_static", &[[0.2777, 0.1237], [0.2735, 0.1215], [0.3338, 0.1706], NO, [0.2657, 0.1163], [0.2723, 0.1200]]),
    ],
};

/// ATE on Bonn RGB-D Dynamic, m. For some systems no standard deviation is given.
#[rustfmt::skip]
static BONN_ATE: Table = Table {
    name: "Table 4",
    systems: &[System::OrbSlam2, System::StaticFusion, System::ReFusion, System::YoloSlam, System::SgSlam, System::Paper],
    rows: &[
        ("crowd", &[[1.120, 0.503], [3.586, NAN], [0.204, NAN], [0.033, NAN], [0.023, 0.014], [0.019, 0.009]]),
        ("crowd2", &[[1.501, 0.664], [0.215, NAN], [0.155, NAN], [0.423, NAN], [0.058, 0.041], [0.025, 0.013]]),
        ("crowd3", &[[1.017, 0.292], [0.168, NAN], [0.137, NAN], [0.069, NAN], [0.032, 0.022], [0.031, 0.020]]),
        ("moving_nonobstructing_box", &[[0.317, 0.113], [0.141, NAN], [0.071, NAN], [0.027, NAN], [0.019, 0.008], [0.023, 0.009]]),
        ("moving_nonobstructing_box2", &[[0.349, 0.065], [0.364, NAN], [0.179, NAN], [0.035, NAN], [0.029, 0.012], [0.029, 0.009]]),
        ("person_tracking", &[[0.997, 0.475], [0.484, NAN], [0.289, NAN], [0.157, NAN], [0.040, 0.014], [0.038, 0.013]]),
        ("person_tracking2", &[[1.107, 0.492], [0.626, NAN], [0.463, NAN], [0.037, NAN], [0.037, 0.015], [0.038, 0.014]]),
        ("synchronous", &[[1.068, 0.521], [0.446, NAN], [0.441, NAN], [0.014, NAN], [0.323, 0.182], [0.013, 0.008]]),
        ("synchronous2", &[[1.168, 0.550], [0.027, NAN], [0.022, NAN], [0.007, NAN], [0.016, 0.013], [0.007, 0.003]]),
    ],
};

/// ATE of a published ablation, m.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Ablated {
    /// The recording, without the camera.
    pub(crate) recording: &'static str,
    /// RMSE with nothing, objects, epipolar constraint, both, and both with depth.
    pub(crate) ate: [f64; 5],
    pub(crate) sd: [f64; 5],
}

/// Location of [`ABLATED`] in the publication of preset `paper`.
pub(crate) const ABLATION_TABLE: &str = "Table 5";

/// All of the camera freiburg3 of TUM RGB-D.
#[rustfmt::skip]
pub(crate) const ABLATED: [Ablated; 5] = [
    Ablated { recording: "walking_xyz", ate: [0.9528, 0.0162, 0.3211, 0.0178, 0.0151], sd: [0.5604, 0.0086, 0.1655, 0.0092, 0.0074] },
    Ablated { recording: "walking_static", ate: [0.4116, 0.0079, 0.0279, 0.0074, 0.0072], sd: [0.1876, 0.0037, 0.0231, 0.0037, 0.0032] },
    Ablated { recording: "walking_rpy", ate: [1.1808, 0.0434, 0.7563, 0.0293, 0.0264], sd: [0.5958, 0.0294, 0.4315, 0.0192, 0.0143] },
    Ablated { recording: "walking_halfsphere", ate: [0.6917, 0.0307, 0.1160, 0.0344, 0.0258], sd: [0.4120, 0.0177, 0.0940, 0.0215, 0.0134] },
    Ablated { recording: "sitting_static", ate: [0.0082, 0.0086, 0.0078, 0.0081, 0.0066], sd: [0.0041, 0.0046, 0.0039, 0.0039, 0.0031] },
];

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(errors: &Errors) -> impl Iterator<Item = (&'static str, Vec<Published>)> {
        let rows = errors.ate.rows.iter();
        rows.map(|(name, _)| (*name, errors.of(name)))
    }

    #[test]
    fn every_published_figure_has_a_listed_source() {
        for errors in [&TUM, &BONN] {
            let text = sources(errors.systems(), errors.tables);
            for (sequence, systems) in rows(errors) {
                assert!(systems.len() >= 5, "{sequence}");
                for p in systems {
                    let ate = p.ate.unwrap();
                    assert!(ate.rmse > 0.0 && ate.rmse < 4.0, "{p:?}");
                    assert!(ate.sd.is_none_or(|sd| sd > 0.0 && sd < ate.rmse), "{p:?}");
                    assert!(text.contains(p.source) && text.contains(&p.mark), "{p:?}");
                    assert!(
                        errors
                            .tables
                            .contains(ate.table.trim_start_matches("Table "))
                    );
                }
            }
            assert!(text.contains("Ours are medians"), "{text}");
            assert_eq!(text.matches("\n- [").count(), 6, "{text}");
        }
        assert_eq!(TUM.of("sitting_static").len(), 5);
        // This source has no figures for it.
        assert_eq!(TUM.of("sitting_rpy"), []);
    }

    #[test]
    fn compared_systems_have_named_rows() {
        let names = |errors: &Errors, sequence| -> Vec<&'static str> {
            errors.of(sequence).iter().map(|p| p.system).collect()
        };
        assert_eq!(
            names(&TUM, "walking_rpy"),
            [
                "ORB-SLAM2",
                "DS-SLAM",
                "RDS-SLAM",
                "Blitz-SLAM",
                "SG-SLAM",
                "published method"
            ]
        );
        assert_eq!(
            names(&BONN, "crowd"),
            [
                "ORB-SLAM2",
                "StaticFusion",
                "ReFusion",
                "YOLO-SLAM",
                "SG-SLAM",
                "published method"
            ]
        );
        let ds = &TUM.of("walking_rpy")[1];
        let of = |f: Option<Figure>| f.map(|f| (f.rmse, f.sd.unwrap(), f.table));
        assert_eq!(of(ds.ate), Some((0.4442, 0.2350, "Table 1")));
        assert_eq!(of(ds.rpe_translation), Some((0.1503, 0.1168, "Table 2")));
        assert_eq!(of(ds.rpe_rotation_deg), Some((3.0042, 2.3065, "Table 3")));
        assert_eq!(ds.ms_per_frame, [(76.46, "i7, P4000")]);
    }

    /// Without its parts the published system is ORB-SLAM2; with all of them it is the one of the other table.
    #[test]
    fn ablation_ends_match_the_published_table() {
        for ablated in ABLATED {
            let table = TUM.of(ablated.recording);
            for (row, k) in [(table.first(), 0), (table.last(), 4)] {
                let ate = row.and_then(|p| p.ate).unwrap();
                assert_eq!((ate.rmse, ate.sd), (ablated.ate[k], Some(ablated.sd[k])));
            }
        }
    }
}
