//! Base64 as VTK writes it: several encodings one after the other, each with its own padding, without a mark where
//! one ends. So it is decoded from the left, as many bytes as are asked for.

/// What is left of a text of base64.
pub struct Base64<'a> {
    text: &'a [u8],
    /// Bytes that were decoded and not yet taken: at most two.
    decoded: Vec<u8>,
}

impl<'a> Base64<'a> {
    pub fn new(text: &'a [u8]) -> Self {
        Self { text, decoded: Vec::new() }
    }

    /// How many characters are left.
    pub fn len(&self) -> usize {
        self.text.len()
    }

    /// The next `count` bytes; none where there are fewer, or where a character is not of base64.
    pub fn take(&mut self, count: usize) -> Option<Vec<u8>> {
        // Four characters make three bytes: a count beyond that asks for no memory.
        if count > self.decoded.len() + self.text.len() / 4 * 3 {
            return None;
        }
        let mut bytes = std::mem::take(&mut self.decoded);
        bytes.reserve_exact(count.saturating_sub(bytes.len()) + 2);
        while bytes.len() < count {
            let (three, length) = self.group()?;
            bytes.extend(three.get(..length)?);
        }
        self.decoded = bytes.split_off(count);
        Some(bytes)
    }

    /// The next four characters, as one to three bytes.
    fn group(&mut self) -> Option<([u8; 3], usize)> {
        let (mut word, mut filled, mut padding) = (0_u32, 0, 0);
        while filled < 4 {
            let (&character, rest) = self.text.split_first()?;
            self.text = rest;
            if character.is_ascii_whitespace() {
                continue;
            }
            if character == b'=' {
                padding += 1;
            } else if padding > 0 {
                return None;
            }
            word = (word << 6) | digit(character)?;
            filled += 1;
        }
        let [_, bytes @ ..] = word.to_be_bytes();
        (padding < 3).then(|| (bytes, 3 - padding))
    }
}

/// The six bits that a character stands for; padding stands for zeros.
fn digit(character: u8) -> Option<u32> {
    Some(u32::from(match character {
        b'A'..=b'Z' => character - b'A',
        b'a'..=b'z' => character - b'a' + 26,
        b'0'..=b'9' => character - b'0' + 52,
        b'+' => 62,
        b'/' => 63,
        b'=' => 0,
        _ => return None,
    }))
}

#[cfg(test)]
mod tests {
    use ::base64::Engine;
    use ::base64::engine::general_purpose::STANDARD;

    use super::*;

    #[test]
    fn encodings_follow_one_another_with_and_without_padding() {
        let data: Vec<u8> = (0..=255).collect();
        for split in 0..=9 {
            let (head, tail) = data.split_at(split);
            let text = STANDARD.encode(head) + "\n  " + &STANDARD.encode(tail) + "<rest";
            let mut base64 = Base64::new(text.as_bytes());
            assert_eq!(base64.take(split).as_deref(), Some(head));
            assert_eq!(base64.take(100).as_deref(), tail.get(..100));
            assert_eq!(base64.take(tail.len() - 100).as_deref(), tail.get(100..));
        }
        // One encoding of all is the same.
        let text = STANDARD.encode(&data);
        let mut base64 = Base64::new(text.as_bytes());
        assert_eq!(base64.take(8).unwrap(), data[..8]);
        assert_eq!(base64.take(248).unwrap(), data[8..]);
    }

    #[test]
    fn what_is_missing_or_no_base64_is_none() {
        for text in ["", "AAA", "A=A=", "A===", "====", "AA-A", "AA\0A"] {
            assert_eq!(Base64::new(text.as_bytes()).take(3), None, "{text}");
        }
        assert_eq!(Base64::new(b"AAAA").take(usize::MAX), None);
        assert_eq!(Base64::new(b"AA==").take(0), Some(vec![]));
    }
}
