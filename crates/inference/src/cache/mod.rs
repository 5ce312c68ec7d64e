//! The model cache: a folder of the user that holds models by name.
//!
//! For a model `NAME`, the folder `models` holds `NAME.onnx`, the network; `NAME.toml`, its card, if it has one; `NAME.record.toml`, its
//! origin ([`Record`]); and, for models whose publisher states no checksum, `NAME.sha256`, the checksum of the first download. During a
//! download there are also `NAME.part` and `NAME.part.toml`. Files placed there by hand are models, too.

mod error;
mod install;
mod listing;
mod name;
mod record;

pub use error::CacheError;
pub use listing::{CachedModel, State, Stray};
pub use name::check_name;
pub use record::{Form, Record, now};

use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// Largest model that is downloaded or read, bytes. Detectors that run on a CPU at the rate of a camera have some ten MB; the limit keeps a
/// server that never ends from filling the disk.
pub const LARGEST: u64 = 512 * 1024 * 1024;

/// A folder of models. It need not exist: the first installation creates it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cache {
    root: PathBuf,
}

/// Determines the customary place of caches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Platform {
    Unix,
    MacOs,
    Windows,
}

const HERE: Platform = if cfg!(windows) {
    Platform::Windows
} else if cfg!(target_os = "macos") {
    Platform::MacOs
} else {
    Platform::Unix
};

impl Cache {
    /// The cache in this folder; models are in its subfolder `models`.
    #[must_use]
    pub fn at(root: impl Into<PathBuf>) -> Self {
        Self { root: root.into() }
    }

    /// The user's cache: `STILLPOINT_CACHE`, else `stillpoint` in `XDG_CACHE_HOME`, else in the system's customary folder: `~/.cache`, on
    /// macOS `~/Library/Caches`, on Windows `%LOCALAPPDATA%`. Empty variables count as unset, and so does a relative `XDG_CACHE_HOME`, as
    /// its specification says. The environment is an argument for the sake of tests.
    ///
    /// # Errors
    /// [`CacheError::NoHome`] if none of them is set.
    pub fn of_user(environment: &dyn Fn(&str) -> Option<OsString>) -> Result<Self, CacheError> {
        Self::of_user_on(HERE, environment)
    }

    fn of_user_on(
        platform: Platform,
        environment: &dyn Fn(&str) -> Option<OsString>,
    ) -> Result<Self, CacheError> {
        let folder = |name: &str| {
            environment(name)
                .filter(|value| !value.is_empty())
                .map(PathBuf::from)
        };
        if let Some(root) = folder("STILLPOINT_CACHE") {
            return Ok(Self::at(root));
        }
        let (custom, looked) = match platform {
            Platform::Unix => (
                folder("HOME").map(|home| home.join(".cache")),
                "STILLPOINT_CACHE, XDG_CACHE_HOME, HOME",
            ),
            Platform::MacOs => (
                folder("HOME").map(|home| home.join("Library/Caches")),
                "STILLPOINT_CACHE, XDG_CACHE_HOME, HOME",
            ),
            Platform::Windows => (
                folder("LOCALAPPDATA"),
                "STILLPOINT_CACHE, XDG_CACHE_HOME, LOCALAPPDATA",
            ),
        };
        folder("XDG_CACHE_HOME")
            .filter(|path| path.is_absolute())
            .or(custom)
            .map(|caches| Self::at(caches.join("stillpoint")))
            .ok_or(CacheError::NoHome { looked })
    }

    /// The folder of the models. It may not exist yet.
    #[must_use]
    pub fn folder(&self) -> PathBuf {
        self.root.join("models")
    }

    /// Path of a model's network, existing or not.
    #[must_use]
    pub fn onnx_path(&self, name: &str) -> PathBuf {
        self.file(name, "onnx")
    }

    /// Path of a model's card, existing or not.
    #[must_use]
    pub fn card_path(&self, name: &str) -> PathBuf {
        self.file(name, "toml")
    }

    /// Path of a model's record, existing or not.
    #[must_use]
    pub fn record_path(&self, name: &str) -> PathBuf {
        self.file(name, "record.toml")
    }

    /// Path of the file with this suffix beside a model, e.g. `NAME.part`, existing or not. The name must have passed [`check_name`].
    #[must_use]
    pub fn file(&self, name: &str, suffix: &str) -> PathBuf {
        self.folder().join(format!("{name}.{suffix}"))
    }

    /// Creates the folder if missing, and returns it.
    ///
    /// # Errors
    /// It cannot be created, or another file is in its way.
    pub fn make(&self) -> Result<PathBuf, CacheError> {
        let folder = self.folder();
        if let Some(path) = in_the_way(&folder) {
            return Err(CacheError::NoFolder {
                path: path.to_owned(),
                found: "a file",
            });
        }
        match std::fs::create_dir_all(&folder) {
            Ok(()) => Ok(folder),
            Err(source) => Err(CacheError::Write {
                path: folder,
                source,
            }),
        }
    }
}

/// The existing part of the path that is not a folder, if any.
pub(crate) fn in_the_way(folder: &Path) -> Option<&Path> {
    folder.ancestors().find(|p| p.exists() && !p.is_dir())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(platform: Platform, variables: &[(&str, &str)]) -> Option<PathBuf> {
        let environment = |name: &str| {
            variables
                .iter()
                .find(|(key, _)| *key == name)
                .map(|(_, value)| OsString::from(value))
        };
        Cache::of_user_on(platform, &environment)
            .ok()
            .map(|cache| cache.folder())
    }

    #[test]
    fn environment_selects_the_cache_folder() {
        use Platform::{MacOs, Unix, Windows};
        let home = ("HOME", "/home/ada");
        let xdg = ("XDG_CACHE_HOME", "/var/caches");
        let own = ("STILLPOINT_CACHE", "/big disk");
        let local = ("LOCALAPPDATA", "/users/ada/local");
        for (platform, variables, folder) in [
            (Unix, vec![home, xdg, own], Some("/big disk/models")),
            (Unix, vec![home, xdg], Some("/var/caches/stillpoint/models")),
            (Unix, vec![home], Some("/home/ada/.cache/stillpoint/models")),
            (
                Unix,
                vec![home, ("XDG_CACHE_HOME", "caches"), ("STILLPOINT_CACHE", "")],
                Some("/home/ada/.cache/stillpoint/models"),
            ),
            (
                MacOs,
                vec![home],
                Some("/home/ada/Library/Caches/stillpoint/models"),
            ),
            (
                Windows,
                vec![home, local],
                Some("/users/ada/local/stillpoint/models"),
            ),
            (Windows, vec![home], None),
            (Unix, vec![local], None),
            (Unix, vec![("HOME", "")], None),
        ] {
            assert_eq!(at(platform, &variables), folder.map(PathBuf::from));
        }
    }

    #[test]
    fn missing_home_reports_the_variable_to_set() {
        let e = Cache::of_user(&|_| None).unwrap_err().to_string();
        assert!(e.contains("set STILLPOINT_CACHE"), "{e}");
    }
}
