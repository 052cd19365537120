//! The lines, words and blocks of bytes of a file, one after the other, with the number of the line.

/// A reader that knows its line. `\n` ends a line; a `\r` before it is a blank as any other.
#[derive(Debug, Clone)]
pub struct Scanner<'a> {
    /// What follows the line.
    rest: &'a [u8],
    /// What is left of the line.
    line: &'a [u8],
    number: u32,
    comment: Option<u8>,
}

impl<'a> Scanner<'a> {
    /// Before the first line of `bytes`. A byte order mark is passed over.
    pub fn new(bytes: &'a [u8]) -> Self {
        let rest = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
        Self { rest, line: &[], number: 0, comment: None }
    }

    /// In the middle of a file: before what `bytes` begin with, which is on line `number`.
    pub fn from_line(bytes: &'a [u8], number: u32) -> Self {
        Self { rest: bytes, line: &[], number: number.saturating_sub(1), comment: None }
    }

    /// What stands between `mark` and the end of its line is no content.
    pub fn with_comments(self, mark: u8) -> Self {
        Self { comment: Some(mark), ..self }
    }

    /// The number of the line, from 1; 0 before the first.
    pub fn number(&self) -> u32 {
        self.number
    }

    /// What follows the line.
    pub fn rest(&self) -> &'a [u8] {
        self.rest
    }

    /// Goes to the next line and returns it.
    pub fn line(&mut self) -> Option<&'a [u8]> {
        if self.rest.is_empty() {
            return None;
        }
        let mut parts = self.rest.splitn(2, |&b| b == b'\n');
        let line = parts.next().unwrap_or_default();
        self.rest = parts.next().unwrap_or_default();
        self.number = self.number.saturating_add(1);
        self.line = match self.comment {
            Some(mark) => line.split(|&b| b == mark).next().unwrap_or_default(),
            None => line,
        };
        Some(self.line)
    }

    /// Goes to the next line that holds a word; whether there is one.
    pub fn next_line(&mut self) -> bool {
        while let Some(line) = self.line() {
            if !line.trim_ascii_start().is_empty() {
                return true;
            }
        }
        false
    }

    /// The next word of the line.
    pub fn word_of_line(&mut self) -> Option<&'a [u8]> {
        let text = self.line.trim_ascii_start();
        if text.is_empty() {
            return None;
        }
        let end = text.iter().position(u8::is_ascii_whitespace).unwrap_or(text.len());
        let (word, rest) = text.split_at(end);
        self.line = rest;
        Some(word)
    }

    /// The next word, of the line or of a later one.
    pub fn word(&mut self) -> Option<&'a [u8]> {
        loop {
            if let Some(word) = self.word_of_line() {
                return Some(word);
            }
            self.line()?;
        }
    }

    /// Passes over what is left of the line.
    pub fn skip_line(&mut self) {
        self.line = &[];
    }

    /// What is left of the line.
    pub fn rest_of_line(&mut self) -> &'a [u8] {
        std::mem::take(&mut self.line)
    }

    /// The next `length` bytes after the line.
    pub fn take(&mut self, length: usize) -> Option<&'a [u8]> {
        let (block, rest) = self.rest.split_at_checked(length)?;
        let lines = block.iter().filter(|&&b| b == b'\n').count();
        self.number = self.number.saturating_add(u32::try_from(lines).unwrap_or(u32::MAX));
        self.rest = rest;
        Some(block)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_know_their_lines() {
        let text = b"\xef\xbb\xbf# top\r\n\r\n a  bc # d\t\r\n\te\n\x0b\x0cf";
        let mut scanner = Scanner::new(text).with_comments(b'#');
        let mut words = Vec::new();
        while let Some(word) = scanner.word() {
            words.push((scanner.number(), word));
        }
        let expected: [(u32, &[u8]); 4] = [(3, b"a"), (3, b"bc"), (4, b"e"), (5, b"\x0b")];
        assert_eq!(words[..3], expected[..3]);
        assert_eq!((words[3].0, scanner.word(), scanner.line()), (5, None, None));
    }

    #[test]
    fn a_line_ends_its_words_and_blocks_count_their_lines() {
        let mut scanner = Scanner::new(b"x 1\n\n2 3\n\n\x00\n\xffend 4");
        assert!(scanner.next_line() && scanner.word_of_line() == Some(b"x"));
        assert!(scanner.next_line() && scanner.number() == 3);
        assert_eq!(scanner.word_of_line(), Some(&b"2"[..]));
        scanner.skip_line();
        assert_eq!((scanner.word_of_line(), scanner.take(99)), (None, None));
        assert_eq!(scanner.take(4), Some(&b"\n\x00\n\xff"[..]));
        assert_eq!((scanner.word(), scanner.number()), (Some(&b"end"[..]), 6));
        assert!(!scanner.next_line());
    }
}
