//! The inputs of all experiments: simulated scenes, and recordings with ground truth below the data folder.
//!
//! `sim:SCENE` is rendered with the run's seed, on which room, people and noise depend; `sim:SCENE@7` always with seed 7. Anything else is
//! a name below the data folder or a path.

use crate::table::{self, Align, Table};
use crate::{Failure, origin};
use std::fmt;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use stillpoint::evaluation::TimedPose;
use stillpoint::recordings::{OpenOptions, open};
use stillpoint::simulator::scene_names;

/// Prefix of simulated scenes.
const SCENE: &str = "sim:";
/// All inputs below the data folder.
const DATA: &str = "data:";
/// Maximum depth of data sets below the data folder.
const DEPTH: usize = 2;

/// Lists the available inputs
#[derive(clap::Args)]
pub(crate) struct Arguments {}

pub(crate) fn list(_: &Arguments) -> Result<ExitCode, Failure> {
    let mut table = Table::new(["input", "is"]).align(1, Align::Left);
    for name in scene_names() {
        table.row([format!("{SCENE}{name}"), "simulated".to_owned()]);
    }
    for (name, path) in found(&data_folder()) {
        table.row([name, path.display().to_string()]);
    }
    table::print(&table);
    Ok(ExitCode::SUCCESS)
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Input {
    /// A scene of the simulator; with `None` it is rendered with the run's seed.
    Scene { scene: String, seed: Option<u64> },
    /// A data set folder or a recording.
    Folder { name: String, path: PathBuf },
}

impl fmt::Display for Input {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Scene { scene, seed: None } => write!(f, "{SCENE}{scene}"),
            Self::Scene {
                scene,
                seed: Some(seed),
            } => write!(f, "{SCENE}{scene}@{seed}"),
            Self::Folder { name, .. } => f.write_str(name),
        }
    }
}

/// `sim:` and `data:` alone are all of a kind.
pub(crate) fn parse(words: &[String]) -> Result<Vec<Input>, Failure> {
    let mut inputs = Vec::new();
    for word in words {
        match word.as_str() {
            SCENE => inputs.extend(scene_names().iter().map(|scene| Input::Scene {
                scene: (*scene).to_owned(),
                seed: None,
            })),
            DATA => {
                let all = found(&data_folder());
                if all.is_empty() {
                    return Err(format!(
                        "{DATA} expected data sets with ground truth below {}, found none; STILLPOINT_DATA names another folder",
                        data_folder().display()
                    )
                    .into());
                }
                inputs.extend(
                    all.into_iter()
                        .map(|(name, path)| Input::Folder { name, path }),
                );
            }
            _ => inputs.push(one(word)?),
        }
    }
    Ok(inputs)
}

fn one(word: &str) -> Result<Input, Failure> {
    let Some(scene) = word.strip_prefix(SCENE) else {
        return folder(word);
    };
    let (scene, seed) = match scene.split_once('@') {
        None => (scene, None),
        Some((scene, seed)) => {
            let seed = seed.parse().map_err(|_| {
                format!("{word}: expected {SCENE}SCENE@SEED with a whole number, found {seed:?}")
            })?;
            (scene, Some(seed))
        }
    };
    if !scene_names().contains(&scene) {
        return Err(format!(
            "{word}: expected one of the simulator's scenes, found {scene:?}; `lab inputs` lists them"
        )
        .into());
    }
    Ok(Input::Scene {
        scene: scene.to_owned(),
        seed,
    })
}

/// A name below the data folder, else a path.
fn folder(word: &str) -> Result<Input, Failure> {
    let data = data_folder();
    for path in [data.join(word), PathBuf::from(word)] {
        if path.exists() {
            let last = path.file_name().map(|n| n.to_string_lossy().into_owned());
            // Outside the data folder the last component suffices.
            let name = if path.starts_with(&data) && !Path::new(word).is_absolute() {
                word.trim_end_matches('/').to_owned()
            } else {
                last.unwrap_or_else(|| word.to_owned())
            };
            return Ok(Input::Folder { name, path });
        }
    }
    Err(format!(
        "{word}: expected {SCENE}SCENE, a name below {} or a path, found nothing; `lab inputs` lists what there is",
        data.display()
    )
    .into())
}

/// The folder of the data sets, as in the tests: `STILLPOINT_DATA`, else `../shared/data` beside the project.
pub(crate) fn data_folder() -> PathBuf {
    let beside = || origin::root().join("../shared/data");
    std::env::var_os("STILLPOINT_DATA").map_or_else(beside, PathBuf::from)
}

fn found(data: &Path) -> Vec<(String, PathBuf)> {
    let mut all = Vec::new();
    let mut open = vec![(data.to_owned(), 0)];
    while let Some((folder, depth)) = open.pop() {
        for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
            let path = entry.path();
            if !path.is_dir() {
                continue;
            }
            if matches!(truth(&path), Ok(Some(_))) {
                let name = path.strip_prefix(data).unwrap_or(&path);
                all.push((name.display().to_string(), path));
            } else if depth + 1 < DEPTH {
                open.push((path, depth + 1));
            }
        }
    }
    all.sort();
    all
}

pub(crate) fn truth(path: &Path) -> Result<Option<Vec<TimedPose>>, Failure> {
    let poses = open(path, &OpenOptions::default())?.ground_truth()?;
    Ok(poses.map(|poses| {
        let timed = |p: stillpoint::datasets::StampedPose| TimedPose {
            stamp: p.stamp,
            world_from_camera: p.world_from_camera,
        };
        poses.into_iter().map(timed).collect()
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inputs_are_scenes_folders_or_groups() {
        let words = ["sim:xyz", "sim:walking_xyz@7", env!("CARGO_MANIFEST_DIR")];
        let inputs = parse(&words.map(str::to_owned)).unwrap();
        let names: Vec<String> = inputs.iter().map(Input::to_string).collect();
        assert_eq!(names, ["sim:xyz", "sim:walking_xyz@7", "lab"]);
        assert_eq!(
            parse(&["sim:".to_owned()]).unwrap().len(),
            scene_names().len()
        );
        for (word, part) in [
            ("sim:nowhere", "one of the simulator's scenes"),
            ("sim:xyz@a", "a whole number"),
            ("/no/such", "found nothing"),
        ] {
            let e = parse(&[word.to_owned()]).unwrap_err().to_string();
            assert!(e.contains(part) && e.contains(word), "{e}");
        }
    }
}
