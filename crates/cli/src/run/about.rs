//! Description of a run in its log, so that a replay needs only the log and the data set.

use crate::args::InputArgs;
use crate::config;
use crate::dense::Logged;
use crate::failure::Failure;
use crate::output::StreamedFile;
use crate::run::known_map::KnownMap;
use crate::run::session::Session;
use crate::run::summary::DetectorJson;
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::path::{Path, PathBuf};
use stillpoint::slam::{Config, MapUse};
use toml::Table;

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct About {
    pub(crate) stillpoint: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) camera: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) color_topic: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) depth_topic: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) info_topic: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) truth_topic: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) imu_topic: Option<String>,
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub(crate) no_imu: bool,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) odometry_topic: Option<String>,
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub(crate) no_odometry: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) depth_scale: Option<f64>,
    /// Frames skipped at the start.
    pub(crate) start: usize,
    /// Map that was resumed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) load_map: Option<PathBuf>,
    /// Map that was localised in.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) localize: Option<PathBuf>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) detector: Option<DetectorJson>,
    /// Frames fused in a live run, where images may have come too late.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) dense: Option<Logged>,
    /// Numbers of the frames in which a live run searched for objects.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) things: Option<Vec<u32>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) simulated: Option<Simulated>,
    pub(crate) config: Table,
}

/// A simulated scene; its seed is that of the configuration.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct Simulated {
    pub(crate) scene: String,
    pub(crate) frames: usize,
}

impl About {
    pub(crate) fn new(
        input: &InputArgs,
        config: &Config,
        map: Option<KnownMap<'_>>,
        detector: &DetectorJson,
    ) -> Result<Self, Failure> {
        let file = |wanted: MapUse| {
            let map = map.filter(|k| k.map_use == wanted);
            map.map(|k| absolute(k.path))
        };
        Ok(Self {
            stillpoint: env!("CARGO_PKG_VERSION").to_owned(),
            camera: input.camera.as_deref().map(|named| {
                let file = Path::new(named);
                // Presets stay as they are.
                if file.is_file() {
                    absolute(file).display().to_string()
                } else {
                    named.to_owned()
                }
            }),
            color_topic: input.topics.color_topic.clone(),
            depth_topic: input.topics.depth_topic.clone(),
            info_topic: input.topics.info_topic.clone(),
            truth_topic: input.topics.truth_topic.clone(),
            imu_topic: input.topics.imu_topic.clone(),
            no_imu: input.topics.no_imu,
            odometry_topic: input.topics.odometry_topic.clone(),
            no_odometry: input.topics.no_odometry,
            depth_scale: input.topics.depth_scale,
            start: input.start,
            load_map: file(MapUse::Grow),
            localize: file(MapUse::Localize),
            detector: Some(detector.clone()),
            dense: None,
            things: None,
            simulated: None,
            config: config::to_table(config)?,
        })
    }

    pub(crate) fn to_text(&self) -> Result<String, Failure> {
        toml::to_string(self)
            .map_err(|e| Failure::input(format!("the run cannot be described as TOML: {e}")))
    }

    /// Reads the description in a log; empty in one of another program. `log` is its path, for messages.
    pub(crate) fn read(text: &str, log: &Path) -> Result<Self, Failure> {
        toml::from_str(text).map_err(|e| {
            Failure::input(format!(
                "{}: expected a description of the run as TOML, found: {}; the log is of another program",
                log.display(),
                e.message().replace('\n', " ")
            ))
        })
    }
}

/// An absolute path, valid from every folder.
fn absolute(path: &Path) -> PathBuf {
    path.canonicalize().unwrap_or_else(|_| path.to_owned())
}

/// The run log for the result folder; with `--log` it is written to that file instead.
pub(crate) fn run_log(
    session: &Session,
    about: &About,
    file: Option<StreamedFile>,
) -> Result<Option<Vec<u8>>, Failure> {
    let Some(mut log) = session.log.clone() else {
        return Ok(None);
    };
    log.about = about.to_text()?;
    let text = log.to_text();
    let Some(mut file) = file else {
        return Ok(Some(text.into_bytes()));
    };
    file.write(|w| w.write_all(text.as_bytes()))?;
    file.finish()?;
    Ok(None)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn run_description_round_trips() {
        let mut config = Config::default();
        config.sensor.calibration_error = 0.1;
        config.seed = 5;
        let input = InputArgs {
            camera: Some("tum_fr3".into()),
            start: 7,
            ..InputArgs::default()
        };
        let map = KnownMap {
            path: Path::new("no such.spmap"),
            map_use: MapUse::Localize,
        };
        let detector = DetectorJson {
            kind: "onnx".into(),
            input_px: Some((416, 320)),
            ..DetectorJson::default()
        };
        let about = About::new(&input, &config, Some(map), &detector).unwrap();
        assert_eq!(about.localize, Some("no such.spmap".into()));
        assert_eq!(about.load_map, None);
        let text = about.to_text().unwrap();
        let log = Path::new("run.log");
        assert_eq!(About::read(&text, log).unwrap(), about);
        let none = About::read("", log).unwrap();
        let args = crate::args::ConfigArgs::default();
        let resolve = |about: &About| config::resolve_over(&about.config, log, &args).unwrap();
        assert_eq!(resolve(&about), config);
        assert_eq!(resolve(&none), Config::default());
        let e = About::read("camera = 3", log).unwrap_err().to_string();
        assert!(e.starts_with("run.log: expected"), "{e}");
    }
}
