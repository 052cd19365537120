//! `chladni completions` and `chladni man`: what shells and manual readers need, made of the command line itself.

use std::path::PathBuf;

use clap::Command;
use clap::builder::Resettable;
use clap_complete::Shell;
use clap_mangen::Man as Page;

use super::exit::Exit;
use super::{Refusal, print};
use crate::publish::atomic;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  chladni completions bash > ~/.local/share/bash-completion/completions/chladni
  chladni completions zsh > ~/.zfunc/_chladni
  chladni completions fish > ~/.config/fish/completions/chladni.fish")]
pub struct Completions {
    /// Which shell
    #[arg(value_enum)]
    shell: Shell,
}

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  chladni man | man -l -
  chladni man --out ~/.local/share/man/man1")]
pub struct Man {
    /// A folder for a page of every command, chladni-run.1 and so on
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Prints the completions of `command`.
pub fn completions(arguments: &Completions, mut command: Command) -> Result<Exit, Refusal> {
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, &mut command, "chladni", &mut script);
    print(&String::from_utf8_lossy(&script))?;
    Ok(Exit::Success)
}

/// Prints the page of `command`, or writes those of all its commands.
pub fn man(arguments: &Man, mut command: Command) -> Result<Exit, Refusal> {
    command.build();
    let Some(folder) = &arguments.out else {
        print(&String::from_utf8_lossy(&page(&command)?))?;
        return Ok(Exit::Success);
    };
    let mut open = vec![command];
    while let Some(command) = open.pop() {
        let name = command.get_display_name().unwrap_or(command.get_name());
        let file = folder.join(format!("{name}.1"));
        atomic::write(&file, &page(&command)?).map_err(Refusal::usage)?;
        open.extend(command.get_subcommands().filter(|c| c.get_name() != "help").cloned());
    }
    print(&format!("the manual pages are in {}", folder.display()))?;
    Ok(Exit::Success)
}

fn page(command: &Command) -> Result<Vec<u8>, Refusal> {
    let help = command.get_after_help().map(ToString::to_string).unwrap_or_default();
    let command = command.clone().after_help(Resettable::Reset);
    let mut text = Vec::new();
    Page::new(command)
        .source(concat!("chladni ", env!("CARGO_PKG_VERSION")))
        .render(&mut text)
        .map_err(Refusal::internal)?;
    text.extend(help.split("\n\n").flat_map(|part| section(part).into_bytes()));
    Ok(text)
}

/// What stands below the options of a command, as a section whose lines stay as they are.
fn section(part: &str) -> String {
    let Some((title, lines)) = part.split_once(":\n") else { return String::new() };
    let title = match title {
        "Exit codes" => "EXIT STATUS".to_owned(),
        other => other.to_uppercase(),
    };
    let line = |line: &str| {
        let line = line.replace('\\', "\\e").replace('-', "\\-");
        // A dot or a quote at the beginning would be a request.
        let guard = if line.starts_with(['.', '\'']) { "\\&" } else { "" };
        format!("{guard}{line}\n")
    };
    format!(".SH \"{title}\"\n.nf\n{}.fi\n", lines.lines().map(line).collect::<String>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_a_section_stay_as_they_are() {
        let help = "Examples:\n  chladni info a.obj --format json\n.hidden \\ 'x'";
        assert_eq!(
            section(help),
            ".SH \"EXAMPLES\"\n.nf\n  chladni info a.obj \\-\\-format json\n\\&.hidden \\e 'x'\n.fi\n"
        );
        assert!(section("Exit codes:\n  0    all well").starts_with(".SH \"EXIT STATUS\""));
    }
}
