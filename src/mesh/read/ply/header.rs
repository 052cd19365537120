//! The header of a PLY file: how its numbers are written, and which elements of which properties there are.

use std::collections::HashSet;

use crate::mesh::error::{Failure, Fault, Place};
use crate::mesh::read::scan::Scanner;
use crate::mesh::read::values::{Layout, Order, Scalar, excerpt, parse};

pub struct Header {
    pub layout: Layout,
    pub elements: Vec<Element>,
}

/// A list of entries that all have the same properties.
pub struct Element {
    pub name: String,
    pub count: usize,
    pub properties: Vec<Property>,
    /// Where it is declared.
    line: u32,
}

pub struct Property {
    name: String,
    pub kind: Kind,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    Scalar(Scalar),
    List { count: Scalar, item: Scalar },
}

impl Header {
    /// Reads up to and including `end_header`.
    pub fn read(scanner: &mut Scanner<'_>) -> Result<Self, Failure> {
        let mut layout = None;
        let mut elements: Vec<Element> = Vec::new();
        let mut names = HashSet::new();
        // The first line is `ply`, or this would be another format.
        scanner.line();
        while scanner.next_line() {
            match scanner.word_of_line().unwrap_or_default() {
                b"comment" | b"obj_info" => {}
                b"end_header" => {
                    let missing = || malformed(scanner, "there is no `format` line".to_owned());
                    return Ok(Self { layout: layout.ok_or_else(missing)?, elements });
                }
                b"format" => layout = Some(format(scanner)?),
                b"element" => {
                    let element = Element::declared(scanner)?;
                    if !names.insert(element.name.clone()) {
                        let problem = format!("there are two elements `{}`", element.name);
                        return Err(malformed(scanner, problem));
                    }
                    elements.push(element);
                }
                b"property" => match elements.last_mut() {
                    Some(element) => element.properties.push(Property::declared(scanner)?),
                    None => {
                        return Err(malformed(scanner, "a property before any element".to_owned()));
                    }
                },
                word => {
                    let word = excerpt(word);
                    return Err(malformed(scanner, format!("the header has no keyword `{word}`")));
                }
            }
        }
        Err(malformed(scanner, "the file ends before `end_header`".to_owned()))
    }
}

fn format(scanner: &mut Scanner<'_>) -> Result<Layout, Failure> {
    match scanner.word_of_line().unwrap_or_default() {
        b"ascii" => Ok(Layout::Lines),
        b"binary_little_endian" => Ok(Layout::Bytes(Order::LittleEndian)),
        b"binary_big_endian" => Ok(Layout::Bytes(Order::BigEndian)),
        word => Err(malformed(scanner, format!("there is no format `{}`", excerpt(word)))),
    }
}

impl Element {
    fn declared(scanner: &mut Scanner<'_>) -> Result<Self, Failure> {
        let name = name(scanner)?;
        let count = parse(scanner.word_of_line().unwrap_or_default(), "a count")
            .map_err(|fault| Failure::at(Place::Line(scanner.number()), fault))?;
        Ok(Self { name, count, properties: Vec::new(), line: scanner.number() })
    }

    /// Which property is the number `name`.
    pub fn scalar(&self, name: &str) -> Result<usize, Failure> {
        self.find(|p| p.name == name && matches!(p.kind, Kind::Scalar(_)), name)
    }

    /// Which property lists the corners.
    pub fn corners(&self) -> Result<usize, Failure> {
        let named = |p: &Property| matches!(p.name.as_str(), "vertex_indices" | "vertex_index");
        self.find(|p| named(p) && matches!(p.kind, Kind::List { .. }), "vertex_indices")
    }

    fn find(&self, wanted: impl Fn(&Property) -> bool, name: &str) -> Result<usize, Failure> {
        let mut found = (0..).zip(&self.properties).filter(|(_, property)| wanted(property));
        let problem = match (found.next(), found.next()) {
            (Some((index, _)), None) => return Ok(index),
            (None, _) => format!("its element `{}` has no property `{name}`", self.name),
            (Some(_), Some(_)) => {
                format!("its element `{}` has the property `{name}` twice", self.name)
            }
        };
        Err(Failure::at(Place::Line(self.line), Fault::Malformed { format: "PLY", problem }))
    }
}

impl Property {
    fn declared(scanner: &mut Scanner<'_>) -> Result<Self, Failure> {
        let word = scanner.word_of_line().unwrap_or_default();
        let kind = if word == b"list" {
            let mut next = || scanner.word_of_line().unwrap_or_default();
            let [count, item] = [next(), next()];
            Kind::List { count: scalar(count, scanner)?, item: scalar(item, scanner)? }
        } else {
            Kind::Scalar(scalar(word, scanner)?)
        };
        Ok(Self { name: name(scanner)?, kind })
    }
}

fn scalar(word: &[u8], scanner: &Scanner<'_>) -> Result<Scalar, Failure> {
    Ok(match word {
        b"char" | b"int8" => Scalar::I8,
        b"uchar" | b"uint8" => Scalar::U8,
        b"short" | b"int16" => Scalar::I16,
        b"ushort" | b"uint16" => Scalar::U16,
        b"int" | b"int32" => Scalar::I32,
        b"uint" | b"uint32" => Scalar::U32,
        b"float" | b"float32" => Scalar::F32,
        b"double" | b"float64" => Scalar::F64,
        _ => return Err(malformed(scanner, format!("there is no type `{}`", excerpt(word)))),
    })
}

fn name(scanner: &mut Scanner<'_>) -> Result<String, Failure> {
    match scanner.word_of_line() {
        Some(word) => Ok(excerpt(word)),
        None => Err(malformed(scanner, "a name is missing".to_owned())),
    }
}

fn malformed(at: &Scanner<'_>, problem: String) -> Failure {
    Failure::at(Place::Line(at.number()), Fault::Malformed { format: "PLY", problem })
}
