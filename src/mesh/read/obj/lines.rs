//! The lines of an OBJ file, with their numbers, and the few of them that are geometry fed to `tobj`.
//!
//! tobj's errors carry no line and its meshes number positions by first use, group by group. So it is given
//! only the `v` and `f` lines, one at a time while this reader keeps count, and first of all a face that
//! calls every position in order ("roll call"): its indices are then those of the file.

use std::borrow::Cow;
use std::io::{self, BufRead, Read};

/// A logical line: continuations joined, comment and surrounding blanks removed.
pub struct Line<'a> {
    /// Counted from 1; the first one of a continued line.
    pub number: usize,
    pub text: Cow<'a, [u8]>,
}

impl Line<'_> {
    pub fn keyword(&self) -> &[u8] {
        self.words().next().unwrap_or(&[])
    }

    pub fn words(&self) -> impl Iterator<Item = &[u8]> {
        self.text.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty())
    }
}

/// The lines of `text` that hold anything.
pub fn lines(text: &[u8]) -> impl Iterator<Item = Line<'_>> {
    let text = text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(text);
    let mut numbered = text.split(|&b| b == b'\n').zip(1..);
    std::iter::from_fn(move || {
        let (line, number) = numbered.next()?;
        let mut text = Cow::Borrowed(bare(line));
        while text.ends_with(b"\\") {
            let joined = text.to_mut();
            joined.pop();
            joined.push(b' ');
            joined.extend_from_slice(numbered.next().map_or(&[], |(line, _)| bare(line)));
        }
        Some(Line { number, text })
    })
    .filter(|line| !line.text.is_empty())
}

fn bare(line: &[u8]) -> &[u8] {
    line.split(|&b| b == b'#').next().unwrap_or(line).trim_ascii()
}

/// Feeds tobj, and remembers which line it was given last.
pub struct Geometry<'a, I> {
    lines: I,
    current: Vec<u8>,
    read: usize,
    /// The line that tobj reads now; `None` while it reads the roll call.
    pub at: Option<Line<'a>>,
    /// Line numbers of the `v` lines so far.
    pub positions: Vec<u32>,
    /// Line numbers of the `f` lines so far.
    pub faces: Vec<u32>,
}

impl<'a, I: Iterator<Item = Line<'a>>> Geometry<'a, I> {
    /// `lines` are those of a file with `positions` lines that start with `v`.
    pub fn new(lines: I, positions: usize) -> Self {
        let mut current = Vec::new();
        if positions > 0 {
            current.extend_from_slice(b"f");
            for index in 1..=positions {
                current.extend_from_slice(format!(" {index}").as_bytes());
            }
            current.push(b'\n');
        }
        Self { lines, current, read: 0, at: None, positions: Vec::new(), faces: Vec::new() }
    }

    fn advance(&mut self) {
        self.current.clear();
        self.read = 0;
        for line in self.lines.by_ref() {
            // Whoever calls has made sure that line numbers fit.
            let number = u32::try_from(line.number).unwrap_or(u32::MAX);
            let words = match line.keyword() {
                b"v" => {
                    self.positions.push(number);
                    // Colours follow x y z on some lines or all: no business of ours.
                    match line.words().count() {
                        7.. => 4,
                        _ => usize::MAX,
                    }
                }
                b"f" => {
                    self.faces.push(number);
                    usize::MAX
                }
                _ => continue,
            };
            for word in line.words().take(words) {
                // tobj would read several numbers where letters of no alphabet are blanks.
                let is_plain = word.iter().all(u8::is_ascii_graphic);
                self.current.extend_from_slice(if is_plain { word } else { b"?" });
                self.current.push(b' ');
            }
            self.current.push(b'\n');
            self.at = Some(line);
            return;
        }
    }
}

impl<'a, I: Iterator<Item = Line<'a>>> BufRead for Geometry<'a, I> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.read >= self.current.len() {
            self.advance();
        }
        Ok(self.current.get(self.read..).unwrap_or(&[]))
    }

    fn consume(&mut self, bytes: usize) {
        self.read += bytes;
    }
}

impl<'a, I: Iterator<Item = Line<'a>>> Read for Geometry<'a, I> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let bytes = self.fill_buf()?.read(into)?;
        self.consume(bytes);
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_counted_joined_and_stripped() {
        let text = b"\xef\xbb\xbf# top\r\n\r\n  v 1 2 3 # here\r\nf 1 2 \\\r\n  3\r\nf 3 2 1";
        let seen: Vec<_> = lines(text)
            .map(|line| (line.number, String::from_utf8_lossy(&line.text).into_owned()))
            .collect();
        assert_eq!(
            seen,
            [(3, "v 1 2 3".to_owned()), (4, "f 1 2  3".to_owned()), (6, "f 3 2 1".to_owned())]
        );
    }

    #[test]
    fn tobj_sees_the_roll_call_and_then_geometry_only() {
        let text = b"mtllib a.mtl\nv 1 2 3 .5 .5 .5\nvt 0 0\nv 4 5 6\nl 1 2\nusemtl\nf 1/1 2/1 2\n";
        let mut reader = Geometry::new(lines(text), 2);
        let mut seen = String::new();
        reader.read_to_string(&mut seen).unwrap();
        assert_eq!(seen, "f 1 2\nv 1 2 3 \nv 4 5 6 \nf 1/1 2/1 2 \n");
        assert_eq!((reader.positions, reader.faces), (vec![2, 4], vec![7]));
    }
}
