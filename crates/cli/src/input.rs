//! Opens the input that the arguments name.

use crate::args::InputArgs;
use crate::console;
use crate::failure::Failure;
use std::path::Path;
use stillpoint::datasets::{CameraChoice, StampedPose};
use stillpoint::recordings::{self, OpenOptions};

/// Opens the data set or recording and prints the guesses.
pub(crate) fn open(path: &Path, input: &InputArgs) -> Result<recordings::Input, Failure> {
    let dataset = recordings::open(path, &options(input))?;
    say(&dataset);
    Ok(dataset)
}

pub(crate) fn say(dataset: &recordings::Input) {
    for guess in dataset.guesses() {
        console::info(guess);
    }
    for warning in dataset.warnings() {
        console::warn(warning);
    }
    let camera = dataset.camera();
    if camera.nominal {
        console::warn(&format!(
            "the camera {} is made of a field of view: lengths and poses err by some per cent; a calibration of your own is better",
            camera.name
        ));
    }
}

/// The arguments as options of `recordings::open`.
pub(crate) fn options(input: &InputArgs) -> OpenOptions {
    OpenOptions {
        camera: input.camera.as_deref().map(CameraChoice::from_argument),
        strict: input.strict,
        colour_topic: input.topics.color_topic.clone(),
        depth_topic: input.topics.depth_topic.clone(),
        info_topic: input.topics.info_topic.clone(),
        truth_topic: input.topics.truth_topic.clone(),
        imu_topic: input.topics.imu_topic.clone(),
        no_imu: input.topics.no_imu,
        odometry_topic: input.topics.odometry_topic.clone(),
        no_odometry: input.topics.no_odometry,
        depth_scale: input.topics.depth_scale,
        ..OpenOptions::default()
    }
}

pub(crate) fn said((poses, remarks): (Vec<StampedPose>, Vec<String>)) -> Vec<StampedPose> {
    remarks.iter().for_each(|r| console::info(r));
    poses
}
