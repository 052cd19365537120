//! The frame of a legacy VTK file: its header, its keywords with their counts and types, and what is passed over.

use crate::mesh::error::{Failure, Fault, Place};
use crate::mesh::read::scan::Scanner;
use crate::mesh::read::values::{Layout, Order, Scalar, Values, excerpt, parse};

/// A file between its sections. Keywords are text in binary files too, and errors at them name the line.
pub struct File<'a> {
    values: Values<'a>,
}

impl<'a> File<'a> {
    /// Reads up to and including the kind of dataset.
    pub fn open(bytes: &'a [u8]) -> Result<Self, Failure> {
        let mut scanner = Scanner::new(bytes);
        // The first line told the format; the second is a title.
        scanner.line();
        scanner.line();
        scanner.skip_line();
        let encoding = scanner.word().map(<[u8]>::to_ascii_uppercase);
        let layout = match encoding.as_deref() {
            Some(b"ASCII") => Some(Layout::Words),
            Some(b"BINARY") => Some(Layout::Bytes(Order::BigEndian)),
            _ => None,
        };
        let values = Values::new("VTK", scanner, layout.unwrap_or(Layout::Words));
        let mut file = Self { values };
        if layout.is_none() {
            return Err(file.malformed("neither ASCII nor BINARY stands in line 3".to_owned()));
        }
        if file.keyword().as_deref() != Some("DATASET") {
            return Err(file.malformed("DATASET is expected here".to_owned()));
        }
        match file.keyword().as_deref() {
            Some("POLYDATA" | "UNSTRUCTURED_GRID") => Ok(file),
            other => Err(file.failure(Fault::NotRead {
                what: format!("the dataset {}", other.unwrap_or_default()),
                remedy: "save the surface as POLYDATA (in ParaView: Extract Surface)",
            })),
        }
    }

    /// The next keyword, in capitals; none at the end of the file.
    pub fn keyword(&mut self) -> Option<String> {
        self.values.scanner.word().map(|word| excerpt(word).to_ascii_uppercase())
    }

    /// Whether the next line begins with `keyword`.
    pub fn next_line_is(&mut self, keyword: &str) -> bool {
        self.values.scanner.skip_line();
        let next = self.values.scanner.rest().trim_ascii_start();
        next.get(..keyword.len()).is_some_and(|word| word.eq_ignore_ascii_case(keyword.as_bytes()))
    }

    /// The count that follows a keyword.
    pub fn count(&mut self) -> Result<usize, Failure> {
        let word = self.values.scanner.word_of_line().unwrap_or_default();
        parse(word, "a count").map_err(|fault| self.failure(fault))
    }

    /// The type that follows a keyword.
    pub fn scalar(&mut self) -> Result<Scalar, Failure> {
        let word = self.values.scanner.word_of_line().unwrap_or_default();
        Ok(match word.to_ascii_lowercase().as_slice() {
            b"char" => Scalar::I8,
            b"unsigned_char" => Scalar::U8,
            b"short" => Scalar::I16,
            b"unsigned_short" => Scalar::U16,
            // An id is written as an int, whatever it is in memory.
            b"int" | b"vtkidtype" => Scalar::I32,
            b"unsigned_int" => Scalar::U32,
            b"long" | b"vtktypeint64" => Scalar::I64,
            b"unsigned_long" | b"vtktypeuint64" => Scalar::U64,
            b"float" => Scalar::F32,
            b"double" => Scalar::F64,
            _ => {
                let what = format!("the data type `{}`", excerpt(word));
                let remedy = "save numbers, and no fields of text or bits";
                return Err(self.failure(Fault::NotRead { what, remedy }));
            }
        })
    }

    /// The numbers that begin on the next line.
    pub fn data(&mut self) -> &mut Values<'a> {
        self.values.scanner.skip_line();
        &mut self.values
    }

    /// Passes over the arrays of a `FIELD`.
    pub fn pass_over_field(&mut self) -> Result<(), Failure> {
        self.values.scanner.word_of_line();
        let mut left = self.count()?;
        while left > 0 {
            match self.keyword().as_deref() {
                Some("METADATA") => self.pass_over_metadata(),
                Some(_) => {
                    let count = self.count()?.checked_mul(self.count()?);
                    let scalar = self.scalar()?;
                    let values = self.data();
                    values.list("FIELD", Place::Entry, count);
                    values.skip(scalar, count.unwrap_or(usize::MAX))?;
                    left -= 1;
                }
                None => return Err(self.malformed("the file ends in a FIELD".to_owned())),
            }
        }
        Ok(())
    }

    /// Passes over a `METADATA` block, which ends with an empty line.
    pub fn pass_over_metadata(&mut self) {
        while self.values.scanner.line().is_some_and(|line| !line.trim_ascii().is_empty()) {}
    }

    /// `fault` at the line of the keyword.
    pub fn failure(&self, fault: Fault) -> Failure {
        Failure::at(Place::Line(self.values.scanner.number()), fault)
    }

    pub fn malformed(&self, problem: String) -> Failure {
        self.failure(Fault::Malformed { format: "VTK", problem })
    }
}
