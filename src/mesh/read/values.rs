//! The numbers of a mesh file, as text or as bytes: every one is there, is a number, and has a place.

use std::str::FromStr;

use super::scan::Scanner;
use crate::mesh::error::{Failure, Fault, Place};

/// How numbers are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Layout {
    /// As text, each entry of a list on a line of its own.
    Lines,
    /// As text, lines broken anywhere.
    Words,
    /// As bytes.
    Bytes(Order),
}

/// Which byte of a number comes first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    LittleEndian,
    BigEndian,
}

/// The type of a number in a binary file. Text is read as what it says, whatever the type: a decimal number of
/// a `float` list is the nearest double.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl Scalar {
    /// In bytes.
    pub fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }
}

enum Number {
    Integer(i64),
    Float(f64),
}

/// The numbers of a file, list by list and entry by entry.
pub struct Values<'a> {
    /// Where the reading is; readers take keywords and names from it.
    pub scanner: Scanner<'a>,
    layout: Layout,
    format: &'static str,
    entries: String,
    promised: Option<usize>,
    place: fn(u32) -> Place,
    index: usize,
}

impl<'a> Values<'a> {
    /// `format` names the format in messages.
    pub fn new(format: &'static str, scanner: Scanner<'a>, layout: Layout) -> Self {
        let (entries, promised) = (String::new(), None);
        Self { scanner, layout, format, entries, promised, place: Place::Entry, index: 0 }
    }

    /// Begins a list. In a binary file its entries are at `place`; in a text file at their lines.
    pub fn list(&mut self, entries: &str, place: fn(u32) -> Place, promised: Option<usize>) {
        self.entries = entries.to_owned();
        (self.place, self.promised, self.index) = (place, promised, 0);
    }

    /// Begins entry `index` of the list.
    pub fn entry(&mut self, index: usize) -> Result<(), Failure> {
        self.index = index;
        if self.layout == Layout::Lines && !self.scanner.next_line() {
            return Err(self.ends_early());
        }
        Ok(())
    }

    /// Where the entry stands; of a text file, the line of the last word that was read.
    pub fn place(&self) -> Place {
        match self.layout {
            Layout::Bytes(_) => (self.place)(u32::try_from(self.index).unwrap_or(u32::MAX)),
            _ => Place::Line(self.scanner.number()),
        }
    }

    /// The next number as a double.
    pub fn float(&mut self, scalar: Scalar) -> Result<f64, Failure> {
        match self.layout {
            Layout::Bytes(order) => Ok(match self.number(scalar, order)? {
                Number::Integer(value) => value as f64,
                Number::Float(value) => value,
            }),
            _ => self.parsed("a number"),
        }
    }

    /// The next three numbers as a position.
    pub fn position(&mut self, scalar: Scalar) -> Result<[f64; 3], Failure> {
        Ok([self.float(scalar)?, self.float(scalar)?, self.float(scalar)?])
    }

    /// The next number as an integer.
    pub fn integer(&mut self, scalar: Scalar) -> Result<i64, Failure> {
        match self.layout {
            Layout::Bytes(order) => match self.number(scalar, order)? {
                Number::Integer(value) => Ok(value),
                // Every such double is an integer, and no other double is one without rounding.
                Number::Float(value) if value.fract() == 0.0 && value.abs() < 2_f64.powi(53) => {
                    Ok(value as i64)
                }
                Number::Float(value) => {
                    Err(self.failure(not_a_number(&value.to_string(), "an integer")))
                }
            },
            _ => self.parsed("an integer"),
        }
    }

    /// The next number as how many there are of something.
    pub fn count(&mut self, scalar: Scalar) -> Result<usize, Failure> {
        let count = self.integer(scalar)?;
        usize::try_from(count)
            .map_err(|_| self.failure(not_a_number(&count.to_string(), "a count")))
    }

    /// The next number as the index of one of `vertices`.
    pub fn vertex(&mut self, scalar: Scalar, vertices: usize) -> Result<u32, Failure> {
        let index = self.integer(scalar)?;
        self.in_range(index, vertices)
    }

    /// `index` as that of one of `vertices`.
    pub fn in_range(&self, index: i64, vertices: usize) -> Result<u32, Failure> {
        let inside = u32::try_from(index).ok().filter(|&i| (i as usize) < vertices);
        inside.ok_or_else(|| self.failure(Fault::IndexOutOfRange { index, vertices }))
    }

    /// Passes over `count` numbers, whatever they are.
    pub fn skip(&mut self, scalar: Scalar, count: usize) -> Result<(), Failure> {
        match self.layout {
            Layout::Bytes(_) => {
                let bytes = count.checked_mul(scalar.size());
                bytes
                    .and_then(|bytes| self.scanner.take(bytes))
                    .ok_or_else(|| self.ends_early())?;
            }
            _ => {
                for _ in 0..count {
                    self.word()?;
                }
            }
        }
        Ok(())
    }

    /// Makes sure that the line of the entry, if it has one, holds no further word.
    pub fn end_of_entry(&mut self) -> Result<(), Failure> {
        match self.layout {
            Layout::Lines if self.scanner.word_of_line().is_some() => Err(self.malformed(format!(
                "the line holds more numbers than the header gives a {}",
                self.entries
            ))),
            _ => Ok(()),
        }
    }

    /// Makes sure that nothing but blanks and zeros follows the last list: its counts were true.
    pub fn end_of_file(&mut self) -> Result<(), Failure> {
        match self.layout {
            Layout::Bytes(_) => {
                let rest = self.scanner.rest();
                if rest.iter().all(|b| b.is_ascii_whitespace() || *b == 0) {
                    return Ok(());
                }
                let problem = format!("{} bytes follow all that its header promises", rest.len());
                Err(Failure::from(Fault::Malformed { format: self.format, problem }))
            }
            _ if self.scanner.word().is_some() => {
                Err(self.malformed("this line follows all that the header promises".to_owned()))
            }
            _ => Ok(()),
        }
    }

    /// `fault` at the entry.
    pub fn failure(&self, fault: Fault) -> Failure {
        Failure::at(self.place(), fault)
    }

    pub fn malformed(&self, problem: String) -> Failure {
        self.failure(Fault::Malformed { format: self.format, problem })
    }

    pub fn ends_early(&self) -> Failure {
        let entries = self.entries.clone();
        self.failure(Fault::EndsEarly { entries, promised: self.promised })
    }

    fn word(&mut self) -> Result<&'a [u8], Failure> {
        let word = match self.layout {
            Layout::Lines => self.scanner.word_of_line(),
            _ => self.scanner.word(),
        };
        word.ok_or_else(|| match self.layout {
            Layout::Lines => self.failure(Fault::ShortLine { entries: self.entries.clone() }),
            _ => self.ends_early(),
        })
    }

    fn parsed<T: FromStr>(&mut self, expected: &'static str) -> Result<T, Failure> {
        let word = self.word()?;
        parse(word, expected).map_err(|fault| self.failure(fault))
    }

    fn number(&mut self, scalar: Scalar, order: Order) -> Result<Number, Failure> {
        Ok(match scalar {
            Scalar::I8 => Number::Integer(i8::from_le_bytes(self.bytes(order)?).into()),
            Scalar::U8 => Number::Integer(u8::from_le_bytes(self.bytes(order)?).into()),
            Scalar::I16 => Number::Integer(i16::from_le_bytes(self.bytes(order)?).into()),
            Scalar::U16 => Number::Integer(u16::from_le_bytes(self.bytes(order)?).into()),
            Scalar::I32 => Number::Integer(i32::from_le_bytes(self.bytes(order)?).into()),
            Scalar::U32 => Number::Integer(u32::from_le_bytes(self.bytes(order)?).into()),
            Scalar::I64 => Number::Integer(i64::from_le_bytes(self.bytes(order)?)),
            // No count and no index is as large.
            Scalar::U64 => Number::Integer(
                i64::try_from(u64::from_le_bytes(self.bytes(order)?)).unwrap_or(i64::MAX),
            ),
            Scalar::F32 => Number::Float(f32::from_le_bytes(self.bytes(order)?).into()),
            Scalar::F64 => Number::Float(f64::from_le_bytes(self.bytes(order)?)),
        })
    }

    /// The next `N` bytes, the least significant first.
    fn bytes<const N: usize>(&mut self, order: Order) -> Result<[u8; N], Failure> {
        let block = self.scanner.take(N).and_then(|block| block.first_chunk::<N>());
        let mut bytes = *block.ok_or_else(|| self.ends_early())?;
        if order == Order::BigEndian {
            bytes.reverse();
        }
        Ok(bytes)
    }
}

/// `word` as a number of any type; `expected` names it in the message.
pub fn parse<T: FromStr>(word: &[u8], expected: &'static str) -> Result<T, Fault> {
    let number = std::str::from_utf8(word).ok().and_then(|word| word.parse().ok());
    number.ok_or_else(|| not_a_number(&excerpt(word), expected))
}

/// The beginning of `text`, for a message.
pub fn excerpt(text: &[u8]) -> String {
    excerpt_of(text, 60)
}

/// The first `length` bytes of `text`, for a message.
pub fn excerpt_of(text: &[u8], length: usize) -> String {
    let shown = text.get(..length).unwrap_or(text);
    String::from_utf8_lossy(shown).chars().filter(|c| !c.is_control()).collect()
}

fn not_a_number(text: &str, expected: &'static str) -> Fault {
    Fault::NotANumber { text: text.to_owned(), expected }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(bytes: &[u8], layout: Layout) -> Values<'_> {
        Values::new("TEST", Scanner::new(bytes), layout)
    }

    fn message(failure: Failure) -> (Option<Place>, String) {
        (failure.place, failure.fault.to_string())
    }

    #[test]
    fn every_type_is_read_in_both_orders() {
        let mut bytes = vec![0xff, 0xff];
        bytes.extend((-2_i16).to_be_bytes());
        bytes.extend(0xfffe_u16.to_be_bytes());
        bytes.extend((-3_i32).to_be_bytes());
        bytes.extend(u32::MAX.to_be_bytes());
        bytes.extend((-4_i64).to_be_bytes());
        bytes.extend(5_u64.to_be_bytes());
        bytes.extend(0.1_f32.to_be_bytes());
        bytes.extend(0.1_f64.to_be_bytes());
        use Scalar::*;
        let types = [I8, U8, I16, U16, I32, U32, I64, U64, F32, F64];
        let expected =
            [-1.0, 255.0, -2.0, 65534.0, -3.0, 4294967295.0, -4.0, 5.0, 0.1_f32.into(), 0.1];
        let read = |bytes: &[u8], order, types: &mut dyn Iterator<Item = Scalar>| {
            let mut values = of(bytes, Layout::Bytes(order));
            types.map(|t| values.float(t).unwrap()).collect::<Vec<_>>()
        };
        assert_eq!(read(&bytes, Order::BigEndian, &mut types.into_iter()), expected);
        bytes.reverse();
        let mut backwards = read(&bytes, Order::LittleEndian, &mut types.into_iter().rev());
        backwards.reverse();
        assert_eq!(backwards, expected);
    }

    #[test]
    fn text_is_a_double_whatever_its_type() {
        let mut values = of(b"0.1 1e-300 +.5 1. -nan 1E5 7", Layout::Words);
        let mut next = || values.float(Scalar::F32).unwrap();
        assert_eq!([next(), next(), next(), next()], [0.1, 1e-300, 0.5, 1.0]);
        assert!(next().is_nan());
        assert_eq!(next(), 1e5);
        assert_eq!(values.count(Scalar::U8).unwrap(), 7);
    }

    #[test]
    fn what_is_missing_or_no_number_has_a_place_and_a_reason() {
        let mut values = of(b"1 2\n3\n", Layout::Lines);
        values.list("vertex", Place::Vertex, Some(9));
        values.entry(0).unwrap();
        values.skip(Scalar::F64, 2).unwrap();
        values.end_of_entry().unwrap();
        values.entry(1).unwrap();
        values.float(Scalar::F64).unwrap();
        let (place, text) = message(values.float(Scalar::F64).unwrap_err());
        assert_eq!(place, Some(Place::Line(2)));
        assert!(text.contains("in the middle of its vertex"), "{text}");
        let (_, text) = message(values.entry(2).unwrap_err());
        assert!(text.contains("promises 9 vertex entries"), "{text}");

        let mut values = of(b"1,5 -3 7", Layout::Words);
        let (_, text) = message(values.float(Scalar::F64).unwrap_err());
        assert!(text.contains("`1,5` as a number") && text.contains("decimal points"), "{text}");
        assert!(message(values.count(Scalar::I32).unwrap_err()).1.contains("`-3` as a count"));
        let (_, text) = message(values.vertex(Scalar::I32, 7).unwrap_err());
        assert!(text.contains("vertex index 7 is out of range: there are 7"), "{text}");

        let mut values = of(b"\0\0\0\x3f\0\0\0\0", Layout::Bytes(Order::LittleEndian));
        values.list("face", Place::Face, Some(3));
        values.entry(2).unwrap();
        let (place, text) = message(values.integer(Scalar::F32).unwrap_err());
        assert_eq!(place, Some(Place::Face(2)));
        assert!(text.contains("`0.5` as an integer"), "{text}");
        assert!(values.skip(Scalar::F64, usize::MAX).is_err());
        assert!(values.end_of_file().is_ok());
        assert!(values.skip(Scalar::U8, 4).is_ok() && values.float(Scalar::I8).is_err());
    }
}
