//! Built-in cameras: the files in `configs/` beside the sources.

type Preset = (&'static str, &'static [&'static str], &'static str);

const PRESETS: [Preset; 13] = [
    (
        "tum_fr1",
        &["fr1", "freiburg1"],
        include_str!("../configs/tum_fr1.toml"),
    ),
    (
        "tum_fr2",
        &["fr2", "freiburg2"],
        include_str!("../configs/tum_fr2.toml"),
    ),
    (
        "tum_fr3",
        &["fr3", "freiburg3"],
        include_str!("../configs/tum_fr3.toml"),
    ),
    ("bonn", &[], include_str!("../configs/bonn.toml")),
    (
        "bonn_calibrated",
        &[],
        include_str!("../configs/bonn_calibrated.toml"),
    ),
    (
        "icl_nuim",
        &["icl"],
        include_str!("../configs/icl_nuim.toml"),
    ),
    (
        "seven_scenes",
        &["7scenes"],
        include_str!("../configs/seven_scenes.toml"),
    ),
    (
        "realsense_d435",
        &["d435"],
        include_str!("../configs/realsense_d435.toml"),
    ),
    (
        "realsense_d455",
        &["d455"],
        include_str!("../configs/realsense_d455.toml"),
    ),
    (
        "realsense_l515",
        &["l515"],
        include_str!("../configs/realsense_l515.toml"),
    ),
    (
        "azure_kinect",
        &["k4a"],
        include_str!("../configs/azure_kinect.toml"),
    ),
    (
        "femto_bolt",
        &["femto"],
        include_str!("../configs/femto_bolt.toml"),
    ),
    ("oak_d", &["oakd"], include_str!("../configs/oak_d.toml")),
];

/// Name and camera file of a preset, by name or alias.
pub(crate) fn preset_text(name: &str) -> Option<(&'static str, &'static str)> {
    PRESETS
        .iter()
        .find(|(n, others, _)| *n == name || others.contains(&name))
        .map(|(n, _, text)| (*n, *text))
}

pub(crate) fn preset_names() -> impl Iterator<Item = &'static str> {
    PRESETS.iter().map(|p| p.0)
}

/// The preset implied by a folder's name, with the matching part of the name.
pub(crate) fn preset_for_folder(name: &str) -> Option<(&'static str, &'static str)> {
    let name = name.to_lowercase();
    [
        ("freiburg1", "tum_fr1"),
        ("freiburg2", "tum_fr2"),
        ("freiburg3", "tum_fr3"),
        ("fr1", "tum_fr1"),
        ("fr2", "tum_fr2"),
        ("fr3", "tum_fr3"),
        ("bonn", "bonn"),
    ]
    .into_iter()
    .find(|(part, _)| name.contains(part))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn camera_preset_is_found_by_folder_name() {
        for (name, preset) in [
            ("rgbd_dataset_freiburg1_xyz", Some("tum_fr1")),
            ("FR2_desk", Some("tum_fr2")),
            ("fr3_walking_xyz", Some("tum_fr3")),
            ("rgbd_bonn_balloon", Some("bonn")),
            ("kitchen", None),
        ] {
            assert_eq!(preset_for_folder(name).map(|p| p.1), preset, "{name}");
        }
    }
}
