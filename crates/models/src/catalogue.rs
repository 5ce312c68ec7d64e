//! The known models: download addresses, and checksums for verification.

use std::fmt;
use stillpoint_inference::{CachedModel, Form, Record};

/// A published model. Other programs may define their own and pass them to [`pull`](crate::pull()).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct KnownModel {
    /// The name in the cache, as in `models pull NAME` and `--detector NAME`.
    pub name: &'static str,
    /// File name.
    pub file: &'static str,
    /// Address.
    pub url: &'static str,
    /// Size of the published file, bytes, if known.
    pub bytes: Option<u64>,
    /// SHA-256 of the published file, 64 lower-case hexadecimal digits, if known.
    pub sha256: Option<&'static str>,
    /// Licence of the weights.
    pub licence: &'static str,
    /// Format of the published file.
    pub form: Form,
    /// Description, one line.
    pub about: &'static str,
}

impl KnownModel {
    /// Record of the published file, obtained from `source` (its own address, a mirror, a file).
    #[must_use]
    pub fn record(&self, source: &str, published: &[u8]) -> Record {
        Record {
            licence: Some(self.licence.to_owned()),
            ..Record::of(source, published)
        }
    }
}

impl fmt::Display for KnownModel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name)
    }
}

/// Prefix of all addresses, which a mirror replaces.
#[cfg(any(test, feature = "pull"))]
pub(crate) const UPSTREAM: &str = "https://github.com";

/// From the most accurate to the fastest.
static KNOWN: [KnownModel; 3] = [
    KnownModel {
        name: "yolov7-tiny",
        file: "yolov7-tiny.pt",
        url: "https://github.com/WongKinYiu/yolov7/releases/download/v0.1/yolov7-tiny.pt",
        bytes: None,
        sha256: None,
        licence: "GPL-3.0",
        form: Form::Checkpoint,
        about: "YOLOv7-tiny, the reference network of the method: 6.2 M parameters, 640x640",
    },
    KnownModel {
        name: "yolox-tiny",
        file: "yolox_tiny.onnx",
        url: "https://github.com/Megvii-BaseDetection/YOLOX/releases/download/0.1.1rc0/yolox_tiny.onnx",
        bytes: Some(20_219_662),
        sha256: Some("427cc366d34e27ff7a03e2899b5e3671425c262ea2291f88bb942bc1cc70b0f7"),
        licence: "Apache-2.0",
        form: Form::Onnx,
        about: "YOLOX-tiny: 5.1 M parameters, 416x416",
    },
    KnownModel {
        name: "yolox-nano",
        file: "yolox_nano.onnx",
        url: "https://github.com/Megvii-BaseDetection/YOLOX/releases/download/0.1.1rc0/yolox_nano.onnx",
        bytes: Some(3_659_407),
        sha256: Some("c789161ed43c8269fcd4e67c67eeeb4e80c622da2eb296a20bc6007bd18a0b7d"),
        licence: "Apache-2.0",
        form: Form::Onnx,
        about: "YOLOX-nano, the smallest and fastest: 0.9 M parameters, 416x416",
    },
];

/// All known models, from the most accurate to the fastest: the order for [`Cache::preferred`](stillpoint_inference::Cache::preferred),
/// since users who download a larger network want to use it.
#[must_use]
pub fn known_models() -> &'static [KnownModel] {
    &KNOWN
}

/// The known model of this name.
#[must_use]
pub fn known(name: &str) -> Option<&'static KnownModel> {
    KNOWN.iter().find(|model| model.name == name)
}

/// The known model whose published file has this checksum (64 lower-case hexadecimal digits).
#[must_use]
pub fn known_by_sha256(sha256: &str) -> Option<&'static KnownModel> {
    KNOWN.iter().find(|model| model.sha256 == Some(sha256))
}

/// The licence of a model's weights, if known: from its record, or because the file is a known one.
#[must_use]
pub fn licence(model: &CachedModel) -> Option<&str> {
    match model.record.as_ref().and_then(|r| r.licence.as_deref()) {
        Some(licence) => Some(licence),
        None => known_by_sha256(&model.sha256).map(|known| known.licence),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_inference::{Cache, sha256_hex};

    #[test]
    fn catalogue_entries_are_valid() {
        for model in known_models() {
            assert_eq!(known(model.name), Some(model), "names are unique");
            stillpoint_inference::check_name(model.name).unwrap();
            assert!(model.url.starts_with(UPSTREAM), "{}", model.url);
            assert!(model.url.ends_with(model.file), "{}", model.url);
            let suffix = match model.form {
                Form::Onnx => ".onnx",
                Form::Checkpoint => ".pt",
            };
            assert!(model.file.ends_with(suffix));
            if let Some(sha256) = model.sha256 {
                assert_eq!(sha256.len(), 64);
                assert!(sha256.chars().all(|c| matches!(c, '0'..='9' | 'a'..='f')));
                assert_eq!(known_by_sha256(sha256), Some(model));
            }
        }
        let sizes = known_models().iter().filter_map(|model| model.bytes);
        assert!(
            sizes.is_sorted_by(|a, b| a >= b),
            "the larger ones come first"
        );
        assert_eq!(known("yolox-huge"), None);
        assert_eq!(known_by_sha256(""), None);
    }

    #[test]
    fn licence_comes_from_the_record_or_the_known_file() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::at(folder.path());
        let nano = known("yolox-nano").unwrap();
        let record = nano.record("https://mirror/yolox_nano.onnx", b"bytes");
        assert_eq!(record.source_sha256, Some(sha256_hex(b"bytes")));
        let mut model = cache.install("net", b"bytes", None, record).unwrap();
        assert_eq!(licence(&model), Some("Apache-2.0"));
        model.record = None;
        assert_eq!(licence(&model), None);
        model.sha256 = nano.sha256.unwrap().to_owned();
        assert_eq!(licence(&model), Some("Apache-2.0"));
    }
}
