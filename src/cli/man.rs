//! `hydroline man`: the manual pages, from the same definition as the help.

use super::output::Output;
use super::print::{bytes, outln};
use super::{CliError, Outcome, command};
use clap_mangen::Man;
use hydroline_core::build_info::BuildInfo;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Without --out the page of hydroline itself goes to stdout.

Examples:
  hydroline man | man -l -
  hydroline man --out ~/.local/share/man/man1    # then: man hydroline-record")]
pub struct Args {
    /// Folder for a page of each subcommand (hydroline-record.1 ...), made if need be; --force replaces older pages there
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    output: Output,
}

pub fn run(args: &Args, build: BuildInfo) -> Result<Outcome, CliError> {
    let pages = pages(build).map_err(CliError::run)?;
    let Some(dir) = &args.out else {
        if let Some((_, page)) = pages.first() {
            bytes(page);
        }
        return Ok(Outcome::Done);
    };
    let names: Vec<&str> = pages.iter().map(|(name, _)| name.as_str()).collect();
    args.output.folder("--out", dir, &names)?;
    std::fs::create_dir_all(dir).map_err(|e| CliError::writing(dir, &e))?;
    for (name, page) in &pages {
        args.output.write(&dir.join(name), page)?;
    }
    outln!("{}: {} pages", dir.display(), pages.len());
    Ok(Outcome::Done)
}

/// File name and text of each page: hydroline itself first, then its subcommands and theirs.
pub(crate) fn pages(build: BuildInfo) -> std::io::Result<Vec<(String, Vec<u8>)>> {
    let mut root = command(build).disable_help_subcommand(true);
    // Gives each subcommand its full name.
    root.build();
    let mut pages = Vec::new();
    collect(&root, &mut pages)?;
    Ok(pages)
}

fn collect(command: &clap::Command, pages: &mut Vec<(String, Vec<u8>)>) -> std::io::Result<()> {
    let man = Man::new(command.clone()).manual("hydroline manual");
    let mut page = Vec::new();
    man.render(&mut page)?;
    // The crate heads what stands after the options with the word EXTRA, whatever it is.
    let text = String::from_utf8_lossy(&page).replace(".SH EXTRA", ".SH NOTES");
    pages.push((man.get_filename(), text.into_bytes()));
    for sub in command.get_subcommands().filter(|c| !c.is_hide_set()) {
        collect(sub, pages)?;
    }
    Ok(())
}
