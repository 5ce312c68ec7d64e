//! Looks at a shared library before the crate `ort` does: `ort` panics on some that it cannot use, waits for pipes, and does
//! not tell whose library it took.
//!
//! The one place beside the SIMD modules where `unsafe` is allowed: symbols of a library that is loaded at run time have no
//! types that a compiler could check.
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

/// What every library of ONNX Runtime exports.
const ENTRY: &[u8] = b"OrtGetApiBase\0";

/// A library that can be used.
pub(super) struct Usable {
    version: String,
    /// The interface that the library gives; it stays for as long as the library, which is never closed.
    api: *const OrtApi,
}

/// Loads a library and asks for its version and interface. Whatever was loaded stays loaded: a library in C++ may have left
/// destructors and threads behind, so that closing it is not safe.
///
/// # Errors
/// [`RuntimeError`] for files that are none, other libraries and old versions.
pub(super) fn check(file: &Path) -> Result<Usable, RuntimeError> {
    let library = || file.to_owned();
    // Opening a pipe would wait for its other end.
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
    // SAFETY: takes nothing; gives a pointer to a static, or null.
    let base = unsafe { entry().as_ref() }.ok_or_else(|| foreign("OrtGetApiBase gives nothing"))?;
    // SAFETY: gives a static text that ends with a zero.
    let version = unsafe { (base.GetVersionString)() };
    if version.is_null() {
        return Err(foreign("it has no version"));
    }
    // SAFETY: not null, see above.
    let version = one_line(&unsafe { CStr::from_ptr(version) }.to_string_lossy());
    // A version that is too old says so itself here, on standard error; asked only if its number promises more.
    let api = match minor(&version) {
        Some(minor) if minor < ORT_API_VERSION => std::ptr::null(),
        // SAFETY: takes any number; gives a pointer to a static, or null for an interface that it does not have.
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

    /// Gives the library to `ort`, which keeps one for the process.
    ///
    /// # Errors
    /// [`RuntimeError::Taken`] if other code of this process has given it another one.
    pub(super) fn hand_over(&self, file: &Path) -> Result<(), RuntimeError> {
        let environment = ort::init_from(file).map_err(|e| RuntimeError::Unloadable {
            library: file.to_owned(),
            reason: one_line(&e),
        })?;
        // Not committed if other code of this process was first; its settings hold then.
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
        // `ort` releases the environment when the process ends; by ELF's order the library's own destructors have run by
        // then, and versions before 1.23 crash (https://github.com/pykeio/ort/issues/614). One user too many keeps it.
        if cfg!(all(unix, not(target_vendor = "apple"))) {
            std::mem::forget(environment);
        }
        Ok(())
    }
}

/// The middle number of a version.
fn minor(version: &str) -> Option<u32> {
    version.split('.').nth(1)?.parse().ok()
}

/// What the system said, which is under what libloading says; without the file's name, which messages begin with.
fn reason(error: &libloading::Error, file: &Path) -> String {
    let said = match std::error::Error::source(error) {
        Some(source) => one_line(&source),
        None => one_line(error),
    };
    let name = format!("{}: ", file.display());
    said.strip_prefix(&name).unwrap_or(&said).to_owned()
}
