//! `hydroline completions`: what the Tab key knows.

use super::{CliError, Outcome, command};
use clap_complete::Shell;
use hydroline_core::build_info::BuildInfo;

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  hydroline completions bash > ~/.local/share/bash-completion/completions/hydroline
  hydroline completions zsh > ~/.zfunc/_hydroline
  hydroline completions fish > ~/.config/fish/completions/hydroline.fish")]
pub struct Args {
    /// Shell to write for
    #[arg(value_enum, value_name = "SHELL")]
    shell: Shell,
}

pub fn run(args: &Args, build: BuildInfo) -> Result<Outcome, CliError> {
    let script = script(args.shell, build);
    super::print::bytes(&script);
    Ok(Outcome::Done)
}

/// The script of one shell. Hidden commands are no suggestion: clap_complete offers them unless they are not there.
pub(crate) fn script(shell: Shell, build: BuildInfo) -> Vec<u8> {
    let whole = command(build);
    let mut shown = clap::Command::new("hydroline")
        .version(whole.get_version().unwrap_or_default().to_owned())
        .args(whole.get_arguments())
        .subcommands(whole.get_subcommands().filter(|c| !c.is_hide_set()));
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut shown, "hydroline", &mut script);
    script
}
