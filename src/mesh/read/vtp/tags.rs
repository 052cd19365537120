//! The tags of an XML file, one after the other. As much of XML as VTK writes: no entities, no namespaces.
//!
//! A parser of all of XML would refuse what VTK itself writes: raw bytes may follow `<AppendedData>`. Reading stops
//! there, since nothing else may.

/// A tag: `<name key="value">`, `<name …/>` or `</name>`.
#[derive(Debug, Clone, Copy)]
pub struct Tag<'a> {
    pub name: &'a [u8],
    pub kind: Kind,
    /// Where it starts, and where what follows it does.
    pub start: usize,
    pub end: usize,
    /// The line on which it ends, from 1.
    pub line: u32,
    attributes: &'a [u8],
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Content follows, and a closing tag.
    Open,
    /// A closing tag.
    Close,
    /// A tag without content, `<name/>`.
    Empty,
}

/// The tags of a file, without comments, declarations and processing instructions.
pub struct Tags<'a> {
    bytes: &'a [u8],
    at: usize,
    line: u32,
}

impl<'a> Tags<'a> {
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0, line: 1 }
    }

    fn go_to(&mut self, end: usize) {
        let passed = self.bytes.get(self.at..end).unwrap_or_default();
        let lines = passed.iter().filter(|&&b| b == b'\n').count();
        self.line = self.line.saturating_add(u32::try_from(lines).unwrap_or(u32::MAX));
        self.at = end;
    }
}

impl<'a> Iterator for Tags<'a> {
    type Item = Tag<'a>;

    fn next(&mut self) -> Option<Tag<'a>> {
        loop {
            let start = self.at + self.bytes.get(self.at..)?.iter().position(|&b| b == b'<')?;
            let rest = self.bytes.get(start..)?;
            if rest.starts_with(b"<!--") {
                let length = rest.windows(3).skip(4).position(|w| w == b"-->")?;
                self.go_to(start + 4 + length + 3);
                continue;
            }
            let length = tag_length(rest)?;
            self.go_to(start + length);
            if rest.starts_with(b"<?") || rest.starts_with(b"<!") {
                continue;
            }
            let inside = rest.get(1..length - 1)?;
            let (inside, kind) = match (inside.strip_prefix(b"/"), inside.strip_suffix(b"/")) {
                (Some(name), _) => (name, Kind::Close),
                (None, Some(inside)) => (inside, Kind::Empty),
                (None, None) => (inside, Kind::Open),
            };
            let ends = |b: &u8| b.is_ascii_whitespace();
            let (name, attributes) =
                inside.split_at(inside.iter().position(ends).unwrap_or(inside.len()));
            let (end, line) = (self.at, self.line);
            return Some(Tag { name, kind, start, end, line, attributes });
        }
    }
}

/// The length of the tag that `text` begins with; a `>` between quotes does not end it.
fn tag_length(text: &[u8]) -> Option<usize> {
    let mut quote = None;
    for (index, &byte) in text.iter().enumerate() {
        match quote {
            Some(open) if byte == open => quote = None,
            Some(_) => {}
            None if byte == b'"' || byte == b'\'' => quote = Some(byte),
            None if byte == b'>' => return Some(index + 1),
            None => {}
        }
    }
    None
}

impl<'a> Tag<'a> {
    /// The value of an attribute, without what surrounds it.
    pub fn attribute(&self, name: &str) -> Option<&'a [u8]> {
        let mut rest = self.attributes;
        loop {
            let equals = rest.iter().position(|&b| b == b'=')?;
            let (key, value) = rest.split_at(equals);
            let value = value.get(1..)?.trim_ascii_start();
            let (&quote, value) = value.split_first()?;
            if quote != b'"' && quote != b'\'' {
                return None;
            }
            let (value, after) = value.split_at(value.iter().position(|&b| b == quote)?);
            if key.trim_ascii() == name.as_bytes() {
                return Some(value.trim_ascii());
            }
            rest = after.get(1..)?;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tags_know_their_names_attributes_and_lines() {
        let text = b"\xef\xbb\xbf<?xml version='1.0'?>\n<!-- <no/> -->\n<a b = \"1 > 2\"\n c='\"'>x</a>\n<d/>";
        let found: Vec<Tag<'_>> = Tags::new(text).collect();
        let names: Vec<_> = found.iter().map(|tag| (tag.name, tag.kind, tag.line)).collect();
        let expected: [(&[u8], Kind, u32); 3] =
            [(b"a", Kind::Open, 4), (b"a", Kind::Close, 4), (b"d", Kind::Empty, 5)];
        assert_eq!(names, expected);
        assert_eq!(found[0].attribute("b"), Some(&b"1 > 2"[..]));
        assert_eq!(found[0].attribute("c"), Some(&b"\""[..]));
        assert_eq!(found[0].attribute("d"), None);
        assert_eq!(&text[found[0].end..found[1].start], b"x");
    }

    #[test]
    fn what_is_not_closed_ends_the_file() {
        for text in ["<a b=\"", "<a", "<", "<!-- -", "<!-->", "<?xml", "text"] {
            assert!(Tags::new(text.as_bytes()).next().is_none(), "{text}");
        }
        for text in ["<>", "</>", "<a b>", "<a b=c>", "<a =\"\">", "<a b=\"c>\">"] {
            let tag = Tags::new(text.as_bytes()).next().unwrap();
            assert_eq!(tag.attribute("x"), None, "{text}");
        }
    }
}
