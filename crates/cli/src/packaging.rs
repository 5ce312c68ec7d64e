//! `completions` and `man`, generated from the command definitions.

use crate::args::Arguments;
use crate::args::packaging::{CompletionsArgs, ManArgs};
use crate::console;
use crate::failure::{Failure, Status};
use crate::output::write_file;
use clap::{Command, CommandFactory};
use clap_mangen::Man;
use clap_mangen::roff::{Roff, bold, roman};

/// Date of the manual pages: that of the last change of the command line. Pages need one, and the build time would make every build
/// different.
const DATE: &str = "2026-11-28";

pub(crate) fn completions(args: &CompletionsArgs) -> Status {
    let mut script = Vec::new();
    clap_complete::generate(
        args.shell,
        &mut Arguments::command(),
        "stillpoint",
        &mut script,
    );
    console::print(&String::from_utf8_lossy(&script));
    Status::Ok
}

pub(crate) fn man(args: &ManArgs) -> Result<Status, Failure> {
    std::fs::create_dir_all(&args.out).map_err(|e| {
        Failure::input(format!(
            "{}: expected a folder, or a name for one, found: {e}; name another",
            args.out.display()
        ))
    })?;
    let pages = pages();
    for (name, text) in &pages {
        write_file(&args.out.join(name), text.as_bytes())?;
    }
    console::report(&format!(
        "{} manual pages in {}\n",
        pages.len(),
        args.out.display()
    ));
    Ok(Status::Ok)
}

fn pages() -> Vec<(String, String)> {
    let mut root = Arguments::command().disable_help_subcommand(true);
    // Adds global options and full names to every command.
    root.build();
    let mut open = vec![root];
    let mut pages = Vec::new();
    while let Some(command) = open.pop() {
        open.extend(command.get_subcommands().cloned());
        pages.push((format!("{}.1", full_name(&command)), page(command)));
    }
    pages.sort();
    pages
}

/// The name of a command's page, such as `stillpoint-map-info`.
fn full_name(command: &Command) -> String {
    let name = command.get_display_name();
    name.unwrap_or_else(|| command.get_name()).to_owned()
}

/// The sections of a manual page. `clap_mangen` would join the lines of examples, so that sections with line breaks are written here.
fn page(command: Command) -> String {
    let version = env!("CARGO_PKG_VERSION");
    let man = Man::new(command.clone())
        .title(full_name(&command).to_uppercase())
        .date(DATE)
        .source(format!("Stillpoint {version}"))
        .manual("Stillpoint");
    let mut text = Vec::new();
    // Writing to a vector cannot fail.
    let _ = man.render_title(&mut text);
    let _ = man.render_name_section(&mut text);
    let _ = man.render_synopsis_section(&mut text);
    let mut description = Roff::new();
    description.control("SH", ["DESCRIPTION"]);
    let about = command.get_long_about().or_else(|| command.get_about());
    lines(
        &mut description,
        &about.map_or_else(String::new, ToString::to_string),
    );
    text.extend(description.to_roff().bytes());
    let _ = man.render_options_section(&mut text);
    if command.has_subcommands() {
        text.extend(commands(&command).to_roff().bytes());
    }
    let mut rest = Roff::new();
    let after = command.get_after_help();
    lines(
        &mut rest,
        &after.map_or_else(String::new, ToString::to_string),
    );
    text.extend(rest.to_roff().bytes());
    tidy(&String::from_utf8_lossy(&text))
}

/// The commands of a command, with the pages about them.
fn commands(command: &Command) -> Roff {
    let mut roff = Roff::new();
    roff.control("SH", ["COMMANDS"]);
    for sub in command.get_subcommands() {
        roff.control("TP", []);
        roff.text([bold(full_name(sub)), roman("(1)")]);
        let about = sub.get_about();
        roff.text([roman(about.map_or_else(String::new, ToString::to_string))]);
    }
    roff
}

/// Help text as roff: a line `Examples:` heads a section, indented lines stay lines, others are paragraphs.
fn lines(roff: &mut Roff, text: &str) {
    let mut kept = false;
    // No paragraph break directly after a heading.
    let mut first = true;
    let mut gap = false;
    for line in text.lines() {
        let indented = line.starts_with(' ');
        if kept && !indented {
            roff.control("fi", []);
            kept = false;
        }
        if line.is_empty() {
            gap = true;
            continue;
        }
        if let Some(heading) = line.strip_suffix(':').filter(|_| !indented) {
            roff.control("SH", [heading.to_uppercase().as_str()]);
            first = true;
        } else {
            if !first && (gap || (indented && !kept)) {
                roff.control("PP", []);
            }
            if indented && !kept {
                roff.control("nf", []);
                kept = true;
            }
            roff.text([roman(line)]);
            first = false;
        }
        gap = false;
    }
    if kept {
        roff.control("fi", []);
    }
}

/// Maximum line length that manual page checkers accept, bytes.
const WIDTH: usize = 80;

/// Removes what manual page checkers reject: trailing spaces, empty and long lines, repeated breaks, and definitions repeated in every
/// section.
fn tidy(text: &str) -> String {
    let mut lines: Vec<String> = Vec::new();
    let mut kept = false;
    for line in text.lines().map(str::trim_end) {
        kept = (kept || line == ".nf") && line != ".fi";
        let before = lines.last().map_or("", String::as_str);
        let defined = line.starts_with(".ie ") || line.starts_with(".el ");
        let again = defined && lines.iter().any(|l| l == line);
        if line.is_empty() || again || (line == ".br" && before == ".br") {
            continue;
        }
        if kept || line.starts_with('.') || before == ".TP" {
            lines.push(line.to_owned());
        } else {
            wrap(line, &mut lines);
        }
    }
    lines.join("\n") + "\n"
}

/// Wraps running text to [`WIDTH`] bytes. No line may begin like a roff command.
fn wrap(text: &str, lines: &mut Vec<String>) {
    let mut line = String::new();
    for word in text.split(' ') {
        if !line.is_empty() && line.len() + 1 + word.len() > WIDTH {
            lines.push(std::mem::take(&mut line));
            if word.starts_with(['.', '\'']) {
                line.push_str("\\&");
            }
        } else if !line.is_empty() {
            line.push(' ');
        }
        line.push_str(word);
    }
    lines.push(line);
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::ValueEnum;
    use clap_complete::Shell;

    fn commands() -> Vec<(String, Command)> {
        let mut root = Arguments::command().disable_help_subcommand(true);
        root.build();
        let (mut open, mut all) = (vec![root], Vec::new());
        while let Some(command) = open.pop() {
            open.extend(command.get_subcommands().cloned());
            all.push((full_name(&command), command));
        }
        all
    }

    fn options(command: &Command) -> Vec<String> {
        let shown = command.get_arguments().filter(|a| !a.is_hide_set());
        let long = shown.filter_map(|a| a.get_long());
        long.map(str::to_owned).collect()
    }

    #[test]
    fn completions_cover_every_command_and_option() {
        let commands = commands();
        assert!(commands.len() > 30, "{} commands", commands.len());
        for shell in Shell::value_variants() {
            let mut script = Vec::new();
            clap_complete::generate(*shell, &mut Arguments::command(), "stillpoint", &mut script);
            let script = String::from_utf8(script).unwrap();
            assert_eq!(
                console::harmless(&script),
                script,
                "{shell} is printed as it is"
            );
            let words: std::collections::BTreeSet<&str> = script
                .split(|c: char| !c.is_ascii_alphanumeric() && c != '-')
                .collect();
            for (name, command) in &commands {
                assert!(words.contains(command.get_name()), "{shell}: {name}");
                for option in options(command) {
                    // Fish scripts have option names without dashes.
                    let dashed = format!("--{option}");
                    assert!(
                        words.contains(dashed.as_str()) || words.contains(option.as_str()),
                        "{shell}: {name} {dashed}"
                    );
                }
            }
        }
    }

    #[test]
    fn manual_pages_cover_commands_options_and_examples() {
        let pages: std::collections::BTreeMap<String, String> = pages().into_iter().collect();
        let commands = commands();
        assert_eq!(pages.len(), commands.len());
        for (name, command) in commands {
            let page = &pages[&format!("{name}.1")];
            let escaped = |text: &str| text.replace('\\', "\\\\").replace('-', "\\-");
            for option in options(&command) {
                assert!(
                    page.contains(&escaped(&format!("--{option}"))),
                    "{name}: --{option}"
                );
            }
            for sub in command.get_subcommands() {
                let line = escaped(&format!("{name}-{}", sub.get_name()));
                assert!(page.contains(&line), "{name}: {line}");
            }
            assert!(page.contains("\n.SH EXAMPLES\n.nf\n"), "{name}: {page}");
            let examples = command.get_after_help().unwrap().to_string();
            for line in examples.lines().filter(|l| l.starts_with("  stillpoint ")) {
                let line = escaped(line.trim_end()) + "\n";
                assert!(page.contains(&line), "{name}: {line}");
            }
        }
    }

    #[test]
    fn long_roff_lines_are_wrapped_and_escaped() {
        let word = "x".repeat(76);
        let text = format!(
            ".SH A\n{word} .a 'b  c\n.br\n.br\n.TP\n{word} {word}\n.nf\n{word} {word}\n.fi"
        );
        let expected = format!(
            ".SH A\n{word} .a\n\\&'b  c\n.br\n.TP\n{word} {word}\n.nf\n{word} {word}\n.fi\n"
        );
        assert_eq!(tidy(&text), expected);
    }

    #[test]
    fn help_text_is_converted_to_roff_structure() {
        let mut roff = Roff::new();
        lines(
            &mut roff,
            "One\ntwo.\n\nThree:\n  a  b\n  .c\n\nFour.\n  d\nFive.",
        );
        assert_eq!(
            tidy(&roff.to_roff()),
            "One\ntwo.\n.SH THREE\n.nf\n  a  b\n  .c\n.fi\n.PP\nFour.\n.PP\n.nf\n  d\n.fi\nFive.\n"
        );
    }
}
