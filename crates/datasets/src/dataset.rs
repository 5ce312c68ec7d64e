//! A data set folder: frames, camera, ground truth, and guesses.

use crate::associate::DEFAULT_MAX_DT;
use crate::camera::{self, CameraChoice, CameraModel};
use crate::error::{DatasetError, Result};
use crate::index::index;
use crate::layout::{self, Layout};
use crate::lists::Said;
use crate::set_back::SetBack;
use crate::source::{DatasetSource, FrameOptions};
use crate::trajectory::StampedPose;
use crate::{ground_truth, imu, odometry, presets, probe};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use stillpoint_imaging::{ImuSample, OdometrySample};

/// Prefix of messages about an inertial sensor.
const INERTIAL: &str = "inertial sensor";
const ODOMETRY: &str = "odometry";

/// How to open a data set; the default guesses everything.
#[derive(Clone, Debug)]
pub struct OpenOptions {
    /// The camera; `None` guesses it.
    pub camera: Option<CameraChoice>,
    /// The layout; `None` guesses it.
    pub layout: Option<Layout>,
    /// End the stream at an unreadable frame instead of skipping it.
    pub strict: bool,
    /// Maximum difference between the stamps of colour and depth, s.
    pub max_dt: f64,
}

impl Default for OpenOptions {
    fn default() -> Self {
        Self {
            camera: None,
            layout: None,
            strict: false,
            max_dt: DEFAULT_MAX_DT,
        }
    }
}

/// A frame: a colour image and its depth image.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// Stamp of the colour image, s.
    pub stamp: f64,
    /// The colour image.
    pub colour: PathBuf,
    /// Stamp of the depth image, s.
    pub depth_stamp: f64,
    /// The depth image.
    pub depth: PathBuf,
}

/// Numbers of listed images and of frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Colour images listed.
    pub colour: usize,
    /// Depth images listed.
    pub depth: usize,
    /// Frames: colour images with depth.
    pub frames: usize,
    /// Colour images without depth.
    pub unmatched_colour: usize,
    /// Depth images without colour.
    pub unmatched_depth: usize,
}

impl Counts {
    pub(crate) fn new(colour: usize, depth: usize, frames: usize) -> Self {
        Self {
            colour,
            depth,
            frames,
            unmatched_colour: colour - frames,
            unmatched_depth: depth - frames,
        }
    }
}

/// An opened data set. Opening reads the lists and examines a few frames; [`Dataset::frames`] reads them.
#[derive(Clone, Debug)]
pub struct Dataset {
    path: PathBuf,
    layout: Layout,
    camera: CameraModel,
    /// Shared with the sources: a list of a million frames takes hundreds of megabytes.
    entries: Arc<[Entry]>,
    counts: Counts,
    strict: bool,
    guesses: Vec<String>,
    warnings: Vec<String>,
    set_back: Vec<SetBack>,
    inertial: Arc<[ImuSample]>,
    odometry: Arc<[OdometrySample]>,
}

impl Dataset {
    /// Opens a folder.
    ///
    /// # Errors
    /// Any [`DatasetError`] about reading: see its variants.
    pub fn open(path: &Path, options: &OpenOptions) -> Result<Self> {
        let names = list_folder(path)?;
        let folder_name = folder_name(path);
        let mut guesses = Vec::new();
        let mut warnings = Vec::new();
        let asked = |data_set: &str| matches!(&options.camera, Some(CameraChoice::Preset(p)) if p.starts_with(data_set));
        let looks_like_bonn = asked("bonn") || folder_name.to_lowercase().contains("bonn");
        let layout = match options.layout {
            Some(layout) => layout,
            None => {
                let (mut layout, why) = layout::guess(path, &names, looks_like_bonn)?;
                if layout == Layout::Numbered && asked("icl") {
                    layout = Layout::IclNuim;
                }
                guesses.push(format!("layout: {layout} ({why})"));
                layout
            }
        };
        let mut said = Said::default();
        let (entries, counts) = index(path, &names, layout, options.max_dt, &mut said)?;
        guesses.append(&mut said.guesses);
        warnings.append(&mut said.warnings);
        guesses.push(format!(
            "frames: {} of {} colour images have one of {} depth images within {} ms",
            counts.frames,
            counts.colour,
            counts.depth,
            options.max_dt * 1e3
        ));
        let mut model = match &options.camera {
            Some(choice) => CameraModel::choose(choice)?,
            None => {
                let (model, why) = guess_camera(path, &folder_name, layout)?;
                guesses.push(format!("camera: {why}"));
                model
            }
        };
        probe::probe(&entries, &mut model, &mut warnings)?;
        model.check_lens(path)?;
        let inertial = imu::read(path, model.imu.as_ref(), &mut warnings)?;
        if !inertial.is_empty() {
            guesses.push(format!("{INERTIAL}: {} samples", inertial.len()));
        }
        let odometry = odometry::read(path, model.odometry.as_ref(), &mut warnings)?;
        if !odometry.is_empty() {
            guesses.push(format!("{ODOMETRY}: {} samples", odometry.len()));
        }
        Ok(Self {
            path: path.to_owned(),
            layout,
            camera: model,
            entries: entries.into(),
            counts,
            strict: options.strict,
            guesses,
            warnings,
            set_back: said.set_back,
            inertial,
            odometry,
        })
    }

    /// The folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The layout, given or guessed.
    #[must_use]
    pub fn layout(&self) -> Layout {
        self.layout
    }

    /// The camera, given or guessed, with the size of the images.
    #[must_use]
    pub fn camera(&self) -> &CameraModel {
        &self.camera
    }

    /// The frames' files in time order.
    #[must_use]
    pub fn entries(&self) -> &[Entry] {
        &self.entries
    }

    pub(crate) fn shared_entries(&self) -> Arc<[Entry]> {
        Arc::clone(&self.entries)
    }

    /// The inertial samples in time order; empty without a sensor, or if the camera file lacks it.
    #[must_use]
    pub fn inertial(&self) -> &Arc<[ImuSample]> {
        &self.inertial
    }

    /// Removes the inertial sensor.
    pub fn leave_out_inertial(&mut self) {
        self.inertial = Arc::default();
        self.camera.imu = None;
        self.guesses.retain(|g| !g.starts_with(INERTIAL));
    }

    /// The odometry samples in time order; empty without odometry, or if the camera file lacks the camera's pose on the base.
    #[must_use]
    pub fn odometry(&self) -> &Arc<[OdometrySample]> {
        &self.odometry
    }

    /// Removes the odometry.
    pub fn leave_out_odometry(&mut self) {
        self.odometry = Arc::default();
        self.camera.odometry = None;
        self.guesses.retain(|g| !g.starts_with(ODOMETRY));
    }

    /// Numbers of listed images and of frames.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// Guesses with their reasons, one sentence each, for the user to check.
    #[must_use]
    pub fn guesses(&self) -> &[String] {
        &self.guesses
    }

    /// Suspicious but usable properties, one sentence each.
    #[must_use]
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// Where the clock was set back during the recording.
    #[must_use]
    pub fn set_back(&self) -> &[SetBack] {
        &self.set_back
    }

    /// True if an unreadable frame ends the stream.
    #[must_use]
    pub(crate) fn is_strict(&self) -> bool {
        self.strict
    }

    /// A source of the decoded frames.
    ///
    /// # Errors
    /// [`DatasetError::NoFrames`] for a `start` after the last frame.
    pub fn frames(&self, options: &FrameOptions) -> Result<DatasetSource> {
        DatasetSource::new(self, options)
    }

    /// Ground truth poses `world_from_camera` of the colour camera, if any.
    ///
    /// # Errors
    /// As [`crate::trajectory::read`].
    pub fn ground_truth(&self) -> Result<Option<Vec<StampedPose>>> {
        Ok(self.ground_truth_said()?.map(|(poses, _)| poses))
    }

    /// Like [`Self::ground_truth`], with remarks about its file, one sentence each.
    ///
    /// # Errors
    /// As [`crate::trajectory::read`].
    pub fn ground_truth_said(&self) -> Result<Option<(Vec<StampedPose>, Vec<String>)>> {
        ground_truth::read(&self.path, self.layout)
    }
}

fn list_folder(path: &Path) -> Result<Vec<String>> {
    if !path.is_dir() {
        let found = if path.exists() { "a file" } else { "nothing" };
        return Err(DatasetError::NoFolder {
            path: path.to_owned(),
            found,
        });
    }
    let names = layout::names_in(path)?;
    if names.is_empty() {
        return Err(DatasetError::EmptyFolder {
            path: path.to_owned(),
        });
    }
    Ok(names)
}

/// The last part of the given path; for `.` or `..`, of the resolved path.
fn folder_name(path: &Path) -> String {
    path.file_name()
        .map(|n| n.to_string_lossy().into_owned())
        .or_else(|| {
            let full = path.canonicalize().ok()?;
            Some(full.file_name()?.to_string_lossy().into_owned())
        })
        .unwrap_or_default()
}

fn guess_camera(path: &Path, folder_name: &str, layout: Layout) -> Result<(CameraModel, String)> {
    for name in ["camera.toml", "camera.txt"] {
        let file = path.join(name);
        if file.is_file() {
            let model = CameraModel::from_file(&file)?;
            return Ok((model, format!("{} (in the folder)", file.display())));
        }
    }
    let (preset, why) = match layout {
        // Others name their images in the same way; folders of 7-Scenes are called seq-01 and so on.
        Layout::SevenScenes if folder_name.to_lowercase().starts_with("seq-") => {
            ("seven_scenes", "the layout says so".to_owned())
        }
        Layout::IclNuim => ("icl_nuim", "the layout says so".to_owned()),
        Layout::Tum | Layout::Bonn => match presets::preset_for_folder(folder_name) {
            Some((part, preset)) => (preset, format!("\"{part}\" in the folder's name")),
            None => return Err(camera::unknown_for_folder(path)),
        },
        Layout::SevenScenes | Layout::Numbered => return Err(camera::unknown_for_folder(path)),
    };
    Ok((
        CameraModel::preset(preset)?,
        format!("preset {preset} ({why})"),
    ))
}
