use super::*;

const FACET: &str = "facet normal 0 0 nan\nouter loop\nvertex 0 0 0\nvertex 0.1 0 0\nvertex 0 1 0\nendloop\nendfacet\n";

fn text() -> String {
    format!("solid facet of a thing\n{FACET}{}endsolid\n", FACET.replace(" 1 0\n", " -1 0\n"))
}

fn binary(header: &str, facets: &[[[f32; 3]; 3]]) -> Vec<u8> {
    let mut bytes = header.as_bytes().to_vec();
    bytes.resize(80, 0);
    bytes.extend((facets.len() as u32).to_le_bytes());
    for facet in facets {
        bytes.extend([0xff; 12]);
        bytes.extend(facet.iter().flatten().flat_map(|c| c.to_le_bytes()));
        bytes.extend([1, 2]);
    }
    bytes
}

const FACETS: [[[f32; 3]; 3]; 2] =
    [[[0., 0., 0.], [0.1, 0., 0.], [0., 1., 0.]], [[0., 0., 0.], [0.1, 0., 0.], [0., -1., 0.]]];

fn failure(bytes: &[u8]) -> (Option<Place>, String) {
    let failure = read(bytes).unwrap_err();
    (failure.place, failure.fault.to_string())
}

#[test]
fn text_keeps_its_digits_and_binary_its_bits() {
    let raw = read(text().as_bytes()).unwrap();
    assert_eq!(raw.triangles, [[0, 1, 2], [3, 4, 5]]);
    assert_eq!(raw.positions[1], [0.1, 0.0, 0.0]);
    assert_eq!(raw.position_place(4), Some(Place::Line(12)));
    assert_eq!(raw.triangle_place(1), Some(Place::Line(9)));
    for header in ["", "solid part\nfacet normal", "\u{feff}solid"] {
        let raw = read(&binary(header, &FACETS)).unwrap();
        assert_eq!(raw.triangles, [[0, 1, 2], [3, 4, 5]]);
        assert_eq!(raw.positions[1], [f64::from(0.1_f32), 0.0, 0.0]);
        assert_eq!(raw.position_place(4), Some(Place::Vertex(4)));
        assert_eq!(raw.triangle_place(1), Some(Place::Face(1)));
        assert_eq!(raw.same_vertex, SameVertex::Position);
    }
}

#[test]
fn case_blanks_and_further_solids_change_nothing() {
    let plain = read(text().as_bytes()).unwrap();
    let in_capitals = text().to_uppercase().replace("NAN", "nan");
    let in_two = text().replacen("endfacet\n", "endfacet\nendsolid a\n\nsolid b\n", 1);
    for text in [in_capitals, in_two, text().replace('\n', "\r\n\t"), format!("\u{feff}{}", text())]
    {
        let raw = read(text.as_bytes()).unwrap();
        assert_eq!(
            (raw.positions, raw.triangles),
            (plain.positions.clone(), plain.triangles.clone())
        );
    }
    assert!(read(b"solid empty\nendsolid empty\n").unwrap().triangles.is_empty());
    assert!(read(&binary("", &[])).unwrap().triangles.is_empty());
}

#[test]
fn text_errors_name_the_line() {
    let cases = [
        ("0.1 0 0", "0.1 0", 6, "cannot read `vertex` as a number"),
        ("0.1 0 0", "0,1 0 0", 5, "cannot read `0,1` as a number"),
        ("vertex 0.1", "point 0.1", 5, "`vertex` is expected here, not `point`"),
        ("endloop", "vertex 1 1 1\nendloop", 7, "`endloop` is expected"),
        ("endfacet", "facet", 8, "`endfacet` is expected"),
        ("endsolid", "end", 16, "not `end`"),
    ];
    for (from, to, number, expected) in cases {
        let (place, message) = failure(text().replacen(from, to, 1).as_bytes());
        assert!(message.contains(expected), "{to}: {message}");
        assert_eq!(place, Some(Place::Line(number)), "{to}: {message}");
    }
    // Cut anywhere, even between two facets: `endsolid` is missing.
    for cut in 5..text().trim_end().len() {
        assert!(read(&text().as_bytes()[..cut]).is_err(), "cut at {cut}");
    }
    let between = text().find("facet normal").unwrap();
    assert!(failure(&text().as_bytes()[..between]).1.contains("before its facet entries do"));
}

#[test]
fn binary_counts_that_lie_are_errors() {
    let whole = binary("solid", &FACETS);
    let (place, message) = failure(&whole[..whole.len() - 1]);
    assert_eq!(place, Some(Place::Face(1)));
    assert!(message.contains("promises 2 facet entries"), "{message}");
    assert!(failure(&whole[..50]).1.contains("before its header entries do"));
    let mut lying = whole.clone();
    lying[80..84].copy_from_slice(&u32::MAX.to_le_bytes());
    assert_eq!(failure(&lying).0, Some(Place::Face(2)));
    lying[80..84].copy_from_slice(&1_u32.to_le_bytes());
    assert!(failure(&lying).1.contains("50 bytes follow"));
    // A few zeros at the end do no harm.
    lying = whole;
    lying.extend([0; 7]);
    assert_eq!(read(&lying).unwrap().triangles.len(), 2);
}
