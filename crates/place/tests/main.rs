//! Place recognition.

#![allow(clippy::unwrap_used)] // Clippy does not recognise test helpers as tests.

mod laws;
mod recordings;
mod vocabulary;
