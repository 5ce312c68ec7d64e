//! Loads models: from the bytes of a file to a ready network.

use crate::args::models::{NetworkArgs, RuntimeChoice};
use crate::console;
use crate::detector::file::Content;
use crate::detector::runtime;
use crate::failure::Failure;
use stillpoint::inference::{ModelCard, ModelError, OnnxDetector, OnnxOptions, Runtime};

#[derive(Clone, Copy, Debug)]
pub(crate) struct Running {
    pub(crate) runtime: RuntimeChoice,
    pub(crate) options: OnnxOptions,
}

impl Running {
    pub(crate) fn new(runtime: RuntimeChoice, threads: u8) -> Self {
        Self {
            runtime,
            options: OnnxOptions {
                threads: threads.into(),
                ..OnnxOptions::default()
            },
        }
    }
}

impl From<NetworkArgs> for Running {
    fn from(args: NetworkArgs) -> Self {
        Self::new(args.runtime, args.threads)
    }
}

pub(crate) struct Network {
    pub(crate) detector: OnnxDetector,
    /// The library that runs it, unless built in.
    pub(crate) library: Option<String>,
}

/// Loads a model in this process. `name` and `option` (the option that named it) are for messages.
///
/// # Errors
/// An invalid card, a model that does not load or run, a missing runtime.
pub(crate) fn load_tried(
    name: &str,
    content: &Content,
    how: &Running,
    option: &str,
) -> Result<Network, Failure> {
    let wrong = |e: &dyn std::fmt::Display| Failure::input(format!("{option} {e}"));
    let card = content.card.as_ref();
    let card = card.map(|(name, text)| ModelCard::parse(name, text));
    let card = card.transpose().map_err(|e| wrong(&e))?;
    let chosen = runtime::choose(how.runtime)?;
    if let Some(warning) = &chosen.warning {
        console::warn(warning);
    }
    let (detector, runtime) = match with_runtime(name, content, card.as_ref(), &chosen.runtime, how)
    {
        Ok(detector) => (detector, chosen.runtime),
        // The library was chosen automatically: a network that it cannot run may work with the built-in runtime.
        Err(e) if how.runtime == RuntimeChoice::Auto && chosen.runtime != Runtime::Rten => {
            let detector = with_runtime(name, content, card.as_ref(), &Runtime::Rten, how)
                .map_err(|_| wrong(&e))?;
            console::warn(&format!("the network is run by rten: {e}"));
            (detector, Runtime::Rten)
        }
        Err(e) => return Err(wrong(&e)),
    };
    Ok(Network {
        detector,
        library: runtime::library(&runtime),
    })
}

fn with_runtime(
    name: &str,
    content: &Content,
    card: Option<&ModelCard>,
    runtime: &Runtime,
    how: &Running,
) -> Result<OnnxDetector, ModelError> {
    OnnxDetector::with_card(content.bytes.clone(), name, card, runtime, &how.options)
}
