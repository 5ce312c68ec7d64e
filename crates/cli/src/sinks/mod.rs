//! The list of all outputs. A further one is a file here, with its options ([`Output`]) and what it does ([`Sink`]), and a line in the list; of the
//! rest of the program nothing changes.

pub(crate) mod dense;
pub(crate) mod folder;
pub(crate) mod json;
pub(crate) mod map;
pub(crate) mod masks;
pub(crate) mod objects;
pub(crate) mod overlay;
pub(crate) mod record;
pub(crate) mod report;
pub(crate) mod things;
pub(crate) mod trace;
pub(crate) mod up;
pub(crate) mod verdicts;
pub(crate) mod view;

use crate::failure::Failure;
use crate::sink::{Output, Sink, Sinks, Start};
use std::path::Path;

macro_rules! outputs {
    ($($module:ident: $output:ident,)*) => {
        /// What is written, and where to.
        #[derive(Clone, Debug, Default, clap::Args)]
        pub(crate) struct OutputArgs {
            $(
                #[command(flatten)]
                pub(crate) $module: $module::$output,
            )*
        }

        impl OutputArgs {
            /// All of them, in the order of the list.
            fn all(&self) -> Vec<&dyn Output> {
                vec![$(&self.$module),*]
            }
        }

        /// The names of their options' groups.
        #[cfg(test)]
        pub(crate) const GROUPS: &[&str] = &[$(stringify!($output)),*];
    };
}

// In the order of the help.
outputs! {
    folder: FolderOutput,
    verdicts: VerdictsOutput,
    objects: ObjectsOutput,
    masks: MasksOutput,
    overlay: OverlayOutput,
    map: SaveMapOutput,
    record: RecordOutput,
    dense: DenseOutput,
    up: UpOutput,
    things: ThingsOutput,
    report: ReportOutput,
    view: ViewOutput,
    json: JsonOutput,
    trace: TraceOutput,
}

impl OutputArgs {
    /// Begins all that are asked for.
    ///
    /// # Errors
    /// The first that cannot be begun.
    pub(crate) fn begin(&self, start: &mut Start<'_>) -> Result<Sinks, Failure> {
        let all = self.all();
        let mut sinks: Vec<Option<Box<dyn Sink>>> = all.iter().map(|_| None).collect();
        // Folders first: the files may lie in one of them.
        for folders in [true, false] {
            for (output, sink) in all.iter().zip(&mut sinks) {
                if output.folders().is_empty() != folders {
                    *sink = output.begin(start)?;
                }
            }
        }
        Ok(Sinks(sinks.into_iter().flatten().collect()))
    }

    /// The files that are written beside the result, by the options that name them.
    pub(crate) fn files(&self) -> Vec<(&'static str, &Path)> {
        self.all().iter().flat_map(|o| o.files()).collect()
    }

    /// The folders that are filled beside the result, by the options that name them.
    pub(crate) fn folders(&self) -> Vec<(&'static str, &Path)> {
        self.all().iter().flat_map(|o| o.folders()).collect()
    }

    /// Whether any of them looks at the colours of frames.
    pub(crate) fn wants_colour(&self) -> bool {
        self.all().iter().any(|o| o.wants_colour())
    }
}
