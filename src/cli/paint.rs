//! Colours for tables on a terminal: what is well green, what has to be looked at yellow, what failed red. Never under `NO_COLOR`, nor in a
//! pipe or a file.

use std::ffi::OsStr;
use std::io::{IsTerminal, stdout};

const GREEN: &str = "\x1b[32m";
const YELLOW: &str = "\x1b[33m";
const RED: &str = "\x1b[31m";
const PLAIN: &str = "\x1b[0m";

/// How lines begin that have a colour as a whole.
const BEGINNINGS: [(&str, &str); 6] = [
    ("complete", GREEN),
    ("not complete", YELLOW),
    ("not known to be complete", YELLOW),
    ("unverified:", YELLOW),
    ("failed:", RED),
    ("* ", YELLOW),
];

/// Words of a table that have a colour, as they stand in a column of their own.
const WORDS: [(&str, &str); 6] = [
    ("  verified", GREEN),
    ("  unverified", YELLOW),
    ("  surpassed", GREEN),
    ("  reproduced", GREEN),
    ("  not reproduced", YELLOW),
    ("  failed", RED),
];

/// A table as it is shown on stdout, here and now.
pub fn painted(text: &str) -> String {
    if is_coloured(&stdout()) {
        text.lines().map(|line| paint(line) + "\n").collect()
    } else {
        text.to_owned()
    }
}

/// Whether what goes there has colours.
pub fn is_coloured(stream: &impl IsTerminal) -> bool {
    coloured(stream.is_terminal(), std::env::var_os("NO_COLOR").as_deref())
}

/// As <https://no-color.org> has it: `NO_COLOR` counts when it is set to anything but nothing.
fn coloured(is_terminal: bool, no_color: Option<&OsStr>) -> bool {
    is_terminal && no_color.is_none_or(OsStr::is_empty)
}

fn paint(line: &str) -> String {
    if let Some((_, colour)) = BEGINNINGS.iter().find(|(start, _)| line.starts_with(start)) {
        return format!("{colour}{line}{PLAIN}");
    }
    let word = WORDS.iter().find_map(|(word, colour)| Some((line.find(word)?, word, colour)));
    match word {
        None => line.to_owned(),
        Some((at, word, colour)) => {
            let (before, after) = (&line[..at], &line[at + word.len()..]);
            let (gap, word) = word.split_at(2);
            format!("{before}{gap}{colour}{word}{PLAIN}{after}")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verdicts_have_colours_and_the_text_stays() {
        let row = "2  1.45950  1.45802  3.2e-3  verified  trained  0.70";
        assert_eq!(paint(row), row.replace("verified", "\x1b[32mverified\x1b[0m"));
        let row = "2  1.45950  1.45802  3.2e-3  unverified  trained  0.70";
        assert_eq!(paint(row), row.replace("unverified", "\x1b[33munverified\x1b[0m"));
        assert!(paint("complete: 8 eigenvalues").starts_with(GREEN));
        assert!(paint("failed: no such file").starts_with(RED));
        assert_eq!(paint("a  b"), "a  b");
    }

    #[test]
    fn only_a_terminal_has_colours_and_not_under_no_color() {
        assert!(coloured(true, None) && coloured(true, Some(OsStr::new(""))));
        assert!(!coloured(true, Some(OsStr::new("1"))));
        assert!(!coloured(false, None) && !coloured(false, Some(OsStr::new("1"))));
    }
}
