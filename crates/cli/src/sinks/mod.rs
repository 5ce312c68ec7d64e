//! The list of all outputs. To add one, write a file here with its options ([`Output`]) and its [`Sink`], and add it to the list.

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
        #[derive(Clone, Debug, Default, clap::Args)]
        pub(crate) struct OutputArgs {
            $(
                #[command(flatten)]
                pub(crate) $module: $module::$output,
            )*
        }

        impl OutputArgs {
            fn all(&self) -> Vec<&dyn Output> {
                vec![$(&self.$module),*]
            }
        }

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
    /// Starts all requested outputs.
    ///
    /// # Errors
    /// The first that cannot be started.
    pub(crate) fn begin(&self, start: &mut Start<'_>) -> Result<Sinks, Failure> {
        let all = self.all();
        let mut sinks: Vec<Option<Box<dyn Sink>>> = all.iter().map(|_| None).collect();
        // Folders first: files may lie in one of them.
        for folders in [true, false] {
            for (output, sink) in all.iter().zip(&mut sinks) {
                if output.folders().is_empty() != folders {
                    *sink = output.begin(start)?;
                }
            }
        }
        Ok(Sinks(sinks.into_iter().flatten().collect()))
    }

    /// Files written outside the result folder, by option.
    pub(crate) fn files(&self) -> Vec<(&'static str, &Path)> {
        self.all().iter().flat_map(|o| o.files()).collect()
    }

    /// Folders filled outside the result folder, by option.
    pub(crate) fn folders(&self) -> Vec<(&'static str, &Path)> {
        self.all().iter().flat_map(|o| o.folders()).collect()
    }

    pub(crate) fn wants_colour(&self) -> bool {
        self.all().iter().any(|o| o.wants_colour())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::args::{Arguments, Command};
    use clap::{Arg, CommandFactory, Parser};

    /// Otherwise two outputs could replace each other, or the input.
    #[test]
    fn all_output_paths_are_known_before_the_run() {
        let mut arguments = Arguments::command();
        arguments.build();
        let run = arguments.find_subcommand("run").unwrap();
        let is_outputs = |arg: &&Arg| {
            let mut groups = run.get_groups();
            groups.any(|g| {
                GROUPS.contains(&g.get_id().as_str()) && g.get_args().any(|id| id == arg.get_id())
            })
        };
        let mut named = Vec::new();
        for arg in run.get_arguments().filter(is_outputs) {
            let value = arg.get_value_names().and_then(|names| names.first());
            let value = value.map_or("", |name| name.as_str());
            let option = format!("--{}", arg.get_long().unwrap());
            let is_folder = value == "DIR" && option != "--out";
            if !is_folder && !value.starts_with("FILE") {
                continue;
            }
            let line = ["stillpoint", "run", "room", &option, "here"];
            let Command::Run(run) = Arguments::try_parse_from(line).unwrap().command else {
                panic!("expected run");
            };
            let (files, folders) = (run.output.files(), run.output.folders());
            let (known, others) = if is_folder {
                (folders, files)
            } else {
                (files, folders)
            };
            assert_eq!(known, [(option.as_str(), Path::new("here"))]);
            assert!(others.is_empty(), "{option}");
            named.push(option);
        }
        assert!(named.len() >= 7, "{named:?}");
    }
}
