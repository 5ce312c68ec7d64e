//! Checks the pages `docs/reference/cli/*.md` and `docs/reference/config.md` against the program. After a change of commands, options or
//! settings, renew them by `STILLPOINT_BLESS=1 cargo test -p stillpoint-cli --lib reference`.

use crate::args::Arguments;
use crate::config::docs::{doc_of, plain_text};
use crate::sinks::GROUPS;
use clap::{Arg, Command, CommandFactory};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use stillpoint::slam::Config;

/// Structs of options that several commands share, with the headings of their tables. Options of other structs belong to one command.
const SHARED: [(&str, &str); 6] = [
    ("InputArgs", "Input"),
    ("TopicArgs", "Recordings"),
    ("OutputArgs", "Output"),
    ("DetectorArgs", "Detector"),
    ("NetworkArgs", "Network"),
    ("ConfigArgs", "Configuration"),
];

fn docs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/reference")
}

/// Escapes help text for Markdown, with options as code.
fn escaped(text: &str) -> String {
    let word = |word: &str| {
        let option = word.trim_start_matches('(');
        let option = option.trim_end_matches([',', ';', ':', '.', ')', ']']);
        if option.starts_with("--") {
            return word.replace(option, &code(option));
        }
        word.chars().fold(String::new(), |mut out, c| {
            match c {
                '<' => out.push_str("&lt;"),
                '*' | '|' | '[' => out.extend(['\\', c]),
                _ => out.push(c),
            }
            out
        })
    };
    text.split(' ').map(word).collect::<Vec<_>>().join(" ")
}

fn cell(text: &str) -> String {
    escaped(&text.split_whitespace().collect::<Vec<_>>().join(" "))
}

fn code(text: &str) -> String {
    format!("`{}`", text.replace('|', "\\|"))
}

/// Paragraphs of a help text: a line `Examples:` heads a section, indented lines are kept as they are.
fn paragraphs(text: &str, level: &str, page: &mut String) {
    let (mut fenced, mut gap) = (false, false);
    for line in text.lines() {
        if line.is_empty() {
            gap = true;
            continue;
        }
        let indented = line.starts_with(' ');
        if fenced && !indented {
            page.push_str("```\n");
        }
        if gap || indented != fenced {
            page.push('\n');
        }
        if indented && !fenced {
            page.push_str("```text\n");
        }
        (fenced, gap) = (indented, false);
        let heading = line
            .strip_suffix(':')
            .filter(|h| !h.contains(' ') || *h == "Exit codes");
        let _ = match heading {
            Some(heading) if !indented => writeln!(page, "{level}# {heading}"),
            _ if indented => writeln!(
                page,
                "{}",
                line.trim_end().strip_prefix("  ").unwrap_or(line)
            ),
            _ => writeln!(page, "{}", escaped(line)),
        };
    }
    if fenced {
        page.push_str("```\n");
    }
}

fn row(arg: &Arg) -> String {
    let short = arg.get_short().map_or(String::new(), |s| format!("-{s}, "));
    let help = arg.get_long_help().or_else(|| arg.get_help());
    let mut text = cell(&help.map_or_else(String::new, ToString::to_string));
    if !text.ends_with(['.', ']']) {
        text.push('.');
    }
    let values = arg.get_possible_values();
    // The values of a flag are not listed.
    if arg.get_action().takes_values() && !values.is_empty() {
        let named = values.iter().map(|v| {
            let help = v.get_help().map(|h| format!(" ({})", cell(&h.to_string())));
            format!("`{}`{}", v.get_name(), help.unwrap_or_default())
        });
        let _ = write!(text, " Values: {}.", named.collect::<Vec<_>>().join(", "));
    }
    if let Some(aliases) = arg.get_visible_aliases().filter(|a| !a.is_empty()) {
        let _ = write!(text, " Also `--{}`.", aliases.join("`, `--"));
    }
    let defaults = arg.get_default_values();
    if arg.get_action().takes_values() && !defaults.is_empty() {
        let value = defaults.join(" ".as_ref());
        let _ = write!(text, " Default: `{}`.", value.to_string_lossy());
    }
    format!("| {} | {text} |\n", code(&format!("{short}{arg}")))
}

fn table(title: &str, level: &str, args: &[&Arg], page: &mut String) {
    if !args.is_empty() {
        let first = if args[0].is_positional() {
            "argument"
        } else {
            "option"
        };
        let _ = write!(page, "\n{level}# {title}\n| {first} | does |\n|---|---|\n");
        page.extend(args.iter().map(|a| row(a)));
    }
}

fn section(command: &Command, level: &str, page: &mut String) {
    let name = command.get_bin_name().unwrap_or_else(|| command.get_name());
    let _ = writeln!(page, "{level} {name}");
    let about = command.get_long_about().or_else(|| command.get_about());
    paragraphs(
        &about.map_or_else(String::new, ToString::to_string),
        level,
        page,
    );
    let usage = command.clone().render_usage().to_string();
    let usage = usage.trim_start_matches("Usage: ");
    let _ = write!(page, "\n```text\n$ {usage}\n```\n");
    let shown = |a: &&Arg| {
        !a.is_hide_set()
            && !a.is_global_set()
            && !["help", "version"].contains(&a.get_id().as_str())
    };
    let (positional, options): (Vec<&Arg>, Vec<&Arg>) = command
        .get_arguments()
        .filter(shown)
        .partition(|a| a.is_positional());
    let group_of = |arg: &&Arg| {
        let groups = command
            .get_groups()
            .filter(|g| g.get_args().any(|id| id == arg.get_id()));
        // Every output has its own argument group.
        let mut ids = groups.map(|g| match g.get_id().as_str() {
            id if GROUPS.contains(&id) => "OutputArgs",
            id => id,
        });
        ids.find_map(|group| SHARED.iter().find(|(id, _)| group == *id))
            .map(|(_, title)| *title)
    };
    let mut groups: BTreeMap<Option<&str>, Vec<&Arg>> = BTreeMap::new();
    for option in options {
        groups.entry(group_of(&option)).or_default().push(option);
    }
    table("Arguments", level, &positional, page);
    table(
        "Options",
        level,
        &groups.remove(&None).unwrap_or_default(),
        page,
    );
    for (_, title) in SHARED {
        table(
            title,
            level,
            &groups.remove(&Some(title)).unwrap_or_default(),
            page,
        );
    }
    let after = command.get_after_help();
    page.push('\n');
    paragraphs(
        &after.map_or_else(String::new, ToString::to_string),
        level,
        page,
    );
    for sub in command.get_subcommands() {
        page.push('\n');
        section(sub, &format!("{level}#"), page);
    }
}

const MADE: &str = "<!-- Made by `STILLPOINT_BLESS=1 cargo test -p stillpoint-cli --lib reference`; a test compares. -->\n";

fn command_pages() -> Vec<(PathBuf, String)> {
    let mut root = Arguments::command().disable_help_subcommand(true);
    root.build();
    let mut list = format!(
        "{MADE}# Commands\nEvery command also has `--help`, and `stillpoint man DIR` writes manual pages.\n\n| command | does |\n|---|---|\n"
    );
    let mut pages = Vec::new();
    for command in root.get_subcommands() {
        let name = command.get_name();
        let about = command
            .get_about()
            .map_or_else(String::new, ToString::to_string);
        let _ = writeln!(list, "| [`{name}`]({name}.md) | {} |", cell(&about));
        for sub in command.get_subcommands() {
            let about = sub
                .get_about()
                .map_or_else(String::new, ToString::to_string);
            let anchor = format!("stillpoint-{name}-{}", sub.get_name());
            let _ = writeln!(
                list,
                "| [`{name} {}`]({name}.md#{anchor}) | {} |",
                sub.get_name(),
                cell(&about)
            );
        }
        let mut page = MADE.to_owned();
        section(command, "#", &mut page);
        pages.push((Path::new("cli").join(format!("{name}.md")), page));
    }
    let global: Vec<&Arg> = root.get_arguments().collect();
    table("Options of every command", "#", &global, &mut list);
    let after = root
        .get_after_help()
        .map_or_else(String::new, ToString::to_string);
    list.push('\n');
    paragraphs(&after, "#", &mut list);
    pages.push((Path::new("cli").join("README.md"), list));
    pages
}

/// The meaning of a setting, and its range, which follows "Range: " in the text.
fn meaning(doc: &str) -> (String, String) {
    let Some((before, rest)) = doc.split_once("Range: ") else {
        return (doc.to_owned(), String::new());
    };
    let (range, after) = rest
        .split_once(". ")
        .unwrap_or((rest.trim_end_matches('.'), ""));
    (format!("{before}{after}"), range.to_owned())
}

fn config_page() -> String {
    let text = plain_text(&Config::default()).unwrap();
    let mut page = format!(
        "{MADE}# Settings\n`stillpoint config print` prints all settings as TOML. `--config FILE` reads such a file, and `--set KEY=VALUE` sets one value: \
         `--set features.features=1500`. Later layers win: defaults, `--config`, each `--set`, `--seed`. The node of ROS 2 takes the same names as parameters.\n"
    );
    let head = "| setting | default | range | meaning |\n|---|---|---|---|\n";
    let mut headed = false;
    let mut section = String::new();
    for line in text.lines() {
        if let Some(name) = line.strip_prefix('[').and_then(|l| l.strip_suffix(']')) {
            section = format!("{name}.");
            let doc = cell(doc_of(name).unwrap_or_default());
            let _ = write!(page, "\n## {name}\n{doc}\n");
            headed = false;
        } else if let Some((key, value)) = line.split_once(" = ") {
            if !std::mem::replace(&mut headed, true) {
                let _ = write!(page, "\n{head}");
            }
            let (doc, range) = meaning(doc_of(&format!("{section}{key}")).unwrap_or_default());
            let _ = writeln!(
                page,
                "| `{key}` | {} | {} | {} |",
                code(value),
                cell(&range),
                cell(&doc)
            );
        }
    }
    page
}

fn compare(name: &Path, expected: &str) {
    let path = docs().join(name);
    if std::env::var_os("STILLPOINT_BLESS").is_some() {
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, expected).unwrap();
    }
    let found = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(
        found == expected,
        "docs/reference/{} differs; renew it: STILLPOINT_BLESS=1 cargo test -p stillpoint-cli --lib reference",
        name.display()
    );
}

#[test]
fn command_pages_match_the_program() {
    let pages = command_pages();
    assert!(pages.len() > 15, "{} pages", pages.len());
    let mut names: Vec<_> = pages.iter().map(|(name, _)| docs().join(name)).collect();
    for (name, text) in &pages {
        compare(name, text);
    }
    let kept = std::fs::read_dir(docs().join("cli")).unwrap();
    let mut kept: Vec<_> = kept.map(|entry| entry.unwrap().path()).collect();
    names.sort();
    kept.sort();
    assert_eq!(kept, names, "pages of commands that there are no longer");
}

#[test]
fn command_pages_list_every_option() {
    let pages: BTreeMap<PathBuf, String> = command_pages().into_iter().collect();
    let page = |name: &str| &pages[&Path::new("cli").join(name)];
    for option in [
        "--dense",
        "--depth-scale <N>",
        "--set <KEY=VALUE>",
        "--detector-threads <N>",
    ] {
        assert!(
            page("run.md").contains(&format!("| `{option}` |")),
            "{option}"
        );
    }
    assert!(page("run.md").contains("\n## Recordings\n"));
    assert!(page("map.md").contains("\n## stillpoint map mesh\n"));
    assert!(page("README.md").contains("| `-q, --quiet` |"));
    let ranged = meaning("How far, m. Range: 0.1 to 100. Beyond it nothing is seen.");
    assert_eq!(
        ranged,
        (
            "How far, m. Beyond it nothing is seen.".into(),
            "0.1 to 100".into()
        )
    );
}

#[test]
fn configuration_page_matches_the_program() {
    compare(Path::new("config.md"), &config_page());
}
