//! Arguments of `completions` and `man`.

use clap::Args;
use clap_complete::Shell;
use std::path::PathBuf;

/// Print completions for a shell.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  stillpoint completions bash > ~/.local/share/bash-completion/completions/stillpoint
  stillpoint completions zsh > ~/.zfunc/_stillpoint
  stillpoint completions fish > ~/.config/fish/completions/stillpoint.fish")]
pub(crate) struct CompletionsArgs {
    /// The shell.
    #[arg(value_name = "SHELL", value_enum)]
    pub(crate) shell: Shell,
}

/// Write manual pages, one per command.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  stillpoint man ~/.local/share/man/man1
  man stillpoint-run")]
pub(crate) struct ManArgs {
    /// Folder to write to; created if missing.
    #[arg(value_name = "DIR")]
    pub(crate) out: PathBuf,
}
