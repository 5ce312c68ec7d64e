//! Checks a shared library before the crate `ort` does: `ort` panics on some unusable ones, blocks on pipes, and does not report which
//! library it loaded.
//!
//! The one place beside the SIMD modules where `unsafe` is allowed: symbols of a library that is loaded at run time have no types that a
//! compiler could check.
#![allow(unsafe_code)]

use super::super::one_line;
use super::error::RuntimeError;
use super::whole;
use libloading::Library;
use ort::sys::{ORT_API_VERSION, OrtApi, OrtApiBase};
use std::ffi::CStr;
use std::path::Path;

/// Oldest version with the interface that `ort` is built for.
pub(super) const OLDEST: &str = "1.17";
const _: () = assert!(ORT_API_VERSION == 17, "OLDEST names another version");

/// Symbol exported by every library of ONNX Runtime.
const ENTRY: &[u8] = b"OrtGetApiBase\0";

pub(super) struct Usable {
    version: String,
    /// Interface of the library; valid as long as the library, which is never closed.
    api: *const OrtApi,
}

/// Loads a library and queries its version and interface. A loaded library is never closed: C++ code may have left destructors and threads
/// behind.
///
/// # Errors
/// [`RuntimeError`] for missing files, other libraries and old versions.
pub(super) fn check(file: &Path) -> Result<Usable, RuntimeError> {
    let library = || file.to_owned();
    // Opening a pipe would block.
    if !file.is_file() {
        return Err(RuntimeError::Missing { library: library() });
    }
    let unloadable = |reason| RuntimeError::Unloadable {
        library: library(),
        reason,
    };
    whole::check(file).map_err(unloadable)?;
    // SAFETY: runs the library's initialisers, which are trusted as its other code is: the caller chose the file.
    let opened = unsafe { Library::new(file) }.map_err(|e| unloadable(reason(&e, file)))?;
    let opened = std::mem::ManuallyDrop::new(opened);
    let foreign = |reason: &str| RuntimeError::Foreign {
        library: library(),
        reason: reason.to_owned(),
    };
    // SAFETY: `OrtGetApiBase` has had this type in all versions (onnxruntime_c_api.h).
    let entry = unsafe { opened.get::<unsafe extern "C" fn() -> *const OrtApiBase>(ENTRY) }
        .map_err(|_| foreign("no symbol OrtGetApiBase"))?;
    // SAFETY: takes nothing; returns a pointer to a static, or null.
    let base = unsafe { entry().as_ref() }.ok_or_else(|| foreign("OrtGetApiBase gives nothing"))?;
    // SAFETY: returns a static zero-terminated text.
    let version = unsafe { (base.GetVersionString)() };
    if version.is_null() {
        return Err(foreign("it has no version"));
    }
    // SAFETY: not null, see above.
    let version = one_line(&unsafe { CStr::from_ptr(version) }.to_string_lossy());
    // A version that is too old prints an error to standard error here; so it is only asked if its version suffices.
    let api = match minor(&version) {
        Some(minor) if minor < ORT_API_VERSION => std::ptr::null(),
        // SAFETY: takes any number; returns a pointer to a static, or null for an interface that it does not have.
        _ => unsafe { (base.GetApi)(ORT_API_VERSION) },
    };
    if api.is_null() {
        return Err(RuntimeError::Old {
            library: library(),
            version,
        });
    }
    Ok(Usable { version, api })
}

impl Usable {
    pub(super) fn version(&self) -> &str {
        &self.version
    }

    /// Passes the library to `ort`, which keeps one for the process.
    ///
    /// # Errors
    /// [`RuntimeError::Taken`] if other code of this process has passed another one.
    pub(super) fn hand_over(&self, file: &Path) -> Result<(), RuntimeError> {
        let environment = ort::init_from(file).map_err(|e| RuntimeError::Unloadable {
            library: file.to_owned(),
            reason: one_line(&e),
        })?;
        // Not committed if other code of this process was first; its settings apply then.
        environment
            .with_name("stillpoint")
            .with_telemetry(false)
            .commit();
        if !std::ptr::eq(ort::api(), self.api) {
            return Err(RuntimeError::Taken {
                library: file.to_owned(),
                loaded: None,
            });
        }
        let environment =
            ort::environment::Environment::current().map_err(|e| RuntimeError::Unloadable {
                library: file.to_owned(),
                reason: one_line(&e),
            })?;
        // `ort` releases the environment when the process ends; by ELF's order the library's own destructors have run by then, and versions
        // before 1.23 crash (https://github.com/pykeio/ort/issues/614). A leaked reference keeps it alive.
        if cfg!(all(unix, not(target_vendor = "apple"))) {
            std::mem::forget(environment);
        }
        Ok(())
    }
}

fn minor(version: &str) -> Option<u32> {
    version.split('.').nth(1)?.parse().ok()
}

/// The system's error under that of libloading, without the file's name, with which messages begin.
fn reason(error: &libloading::Error, file: &Path) -> String {
    let said = match std::error::Error::source(error) {
        Some(source) => one_line(&source),
        None => one_line(error),
    };
    let name = format!("{}: ", file.display());
    said.strip_prefix(&name).unwrap_or(&said).to_owned()
}
