//! Where detectors come from: models that are downloaded into the user's cache, and checkpoints that are turned into ONNX.
//!
//! Answers: which models are known, which of them are here, and how one that is not gets here. Does not run networks (crate
//! `detection`).
