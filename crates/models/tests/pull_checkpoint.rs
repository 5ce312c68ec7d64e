//! A downloaded checkpoint becomes a network with its card.

#![cfg(feature = "pull")]
use crate::pull_support::*;
use stillpoint_inference::{
    Form, InputSize, ModelCard, OnnxDetector, OnnxOptions, Runtime, State, sha256_hex,
};
use stillpoint_models::{Checksum, KnownModel, PullError};

/// A small network of the structure of YOLOv7-tiny with random weights.
const CHECKPOINT: &[u8] = include_bytes!("fixtures/idetect.pt");

fn checkpoint() -> KnownModel {
    KnownModel {
        form: Form::Checkpoint,
        ..unknown()
    }
}

#[test]
fn pulled_checkpoint_becomes_a_detector() {
    let (server, scratch) = (Server::of(CHECKPOINT), Scratch::new());
    let pulled = get(&checkpoint(), &scratch.cache, &server).unwrap();
    assert_eq!(pulled.checksum, Checksum::Recorded);
    assert_eq!(pulled.sha256, sha256_hex(CHECKPOINT));
    let model = scratch.cache.find("made-up").unwrap().unwrap();
    assert_eq!(model.state, State::Good);
    assert_ne!(model.sha256, pulled.sha256);
    assert_eq!(
        scratch.files(),
        [
            "made-up.onnx",
            "made-up.record.toml",
            "made-up.sha256",
            "made-up.toml"
        ]
    );
    let text = model.card_text().unwrap().unwrap();
    let card = ModelCard::parse("made-up.toml", &text).unwrap();
    let options = OnnxOptions {
        input: InputSize::Model,
        ..OnnxOptions::default()
    };
    let bytes = model.read().unwrap();
    OnnxDetector::with_card(bytes, "made-up", Some(&card), &Runtime::Rten, &options).unwrap();
}

#[test]
fn damaged_checkpoint_is_refused() {
    let mut damaged = CHECKPOINT.to_vec();
    let middle = damaged.len() / 2;
    damaged[middle] ^= 0x55;
    for bytes in [
        damaged,
        CHECKPOINT[..middle].to_vec(),
        b"PK\x03\x04".to_vec(),
    ] {
        let (server, scratch) = (Server::of(bytes.leak()), Scratch::with_older());
        let result = get(&checkpoint(), &scratch.cache, &server);
        let e = failed(result, &scratch);
        assert!(matches!(e, PullError::Convert { .. }), "{e}");
        assert!(e.to_string().contains("models import"), "{e}");
    }
}
