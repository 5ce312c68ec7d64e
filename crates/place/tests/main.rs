//! Place recognition.

#![allow(clippy::unwrap_used)] // Helpers of tests are not recognised as tests.

mod laws;
mod recordings;
mod vocabulary;
