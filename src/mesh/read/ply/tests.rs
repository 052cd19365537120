use super::*;

const HEADER: &str = "ply\nformat ascii 1.0\ncomment by hand\nelement vertex 4\nproperty float x\n\
    property float y\nproperty float z\nelement face 2\nproperty list uchar int vertex_indices\n\
    end_header\n";
const BODY: &str = "0 0 0\n0.1 0 0\n1 1 0\n0 1 0\n3 2 1 0\n4 0 1 2 3\n";

fn text() -> String {
    format!("{HEADER}{BODY}")
}

fn failure(bytes: &[u8]) -> (Option<Place>, String) {
    let failure = read(bytes).unwrap_err();
    (failure.place, failure.fault.to_string())
}

fn same(a: &RawMesh, b: &RawMesh) -> bool {
    (&a.positions, &a.triangles) == (&b.positions, &b.triangles)
}

/// A binary file with everything that may stand between positions and corners.
fn binary(order: &str) -> Vec<u8> {
    let header = format!(
        "ply\r\nformat {order} 1.0\r\nobj_info x\r\nelement material 2\r\nproperty uchar red\r\n\
         property list ushort double weights\r\nelement face 2\r\nproperty uchar flag\r\n\
         property list uint8 uint32 vertex_index\r\nproperty list uchar float texcoord\r\n\
         element nothing 4000000000\r\nelement vertex 4\r\nproperty double z\r\nproperty list char short ring\r\n\
         property int16 x\r\nproperty uint8 quality\r\nproperty float64 y\r\nend_header\r\n"
    );
    let mut bytes = header.into_bytes();
    let big = order.contains("big");
    let mut put = |number: &[u8]| match big {
        true => bytes.extend(number.iter().rev()),
        false => bytes.extend(number),
    };
    for weights in [&[][..], &[1.5, 2.5]] {
        put(&[7]);
        put(&(weights.len() as u16).to_le_bytes());
        weights.iter().for_each(|w: &f64| put(&w.to_le_bytes()));
    }
    for corners in [&[2_u32, 1, 0][..], &[0, 1, 2, 3]] {
        put(&[1]);
        put(&[corners.len() as u8]);
        corners.iter().for_each(|i| put(&i.to_le_bytes()));
        put(&[1]);
        put(&0.5_f32.to_le_bytes());
    }
    for (x, y) in [(0_i16, 0_f64), (-1, 0.1), (1, 1.0), (0, 1.0)] {
        put(&0.2_f64.to_le_bytes());
        put(&[2]);
        (0..2).for_each(|i: i16| put(&i.to_le_bytes()));
        put(&x.to_le_bytes());
        put(&[9]);
        put(&y.to_le_bytes());
    }
    bytes
}

#[test]
fn text_keeps_its_digits_whatever_the_type() {
    let raw = read(text().as_bytes()).unwrap();
    assert_eq!(raw.positions[1], [0.1, 0.0, 0.0]);
    assert_eq!(raw.triangles, [[2, 1, 0], [0, 1, 2], [0, 2, 3]]);
    assert_eq!(raw.position_place(1), Some(Place::Line(12)));
    assert_eq!(raw.triangle_place(2), Some(Place::Line(16)));
    assert_eq!(raw.polygons, [Place::Line(16)]);
}

#[test]
fn properties_and_elements_stand_in_any_order_and_both_byte_orders() {
    for order in ["binary_little_endian", "binary_big_endian"] {
        let raw = read(&binary(order)).unwrap();
        assert_eq!(raw.positions, [[0., 0., 0.2], [-1., 0.1, 0.2], [1., 1., 0.2], [0., 1., 0.2]]);
        assert_eq!(raw.triangles, [[2, 1, 0], [0, 1, 2], [0, 2, 3]]);
        assert_eq!(raw.position_place(2), Some(Place::Vertex(2)));
        assert_eq!(raw.triangle_place(2), Some(Place::Face(1)));
        assert_eq!(raw.polygons, [Place::Face(1)]);
    }
}

#[test]
fn line_ends_blanks_comments_and_colours_change_nothing() {
    let plain = read(text().as_bytes()).unwrap();
    let coloured = text()
        .replace("float z\n", "float z\nproperty uchar red\n")
        .replacen("0 0 0\n", "0 0 0 nan\n", 1)
        .replacen("0.1 0 0\n", "0.1 0 0 999\n", 1)
        .replacen("\n1 1 0\n0 1 0\n", "\n1 1 0 -\n0 1 0 .5\n", 1);
    let variants = [
        coloured,
        text().replace('\n', "\r\n"),
        text().replace('\n', " \t\n"),
        format!("\u{feff}{}", text()),
        text().replace("end_header\n", "end_header\n\n\n") + "\n \n",
        text().replace("element face", "comment\nobj_info\nelement   face"),
        text().replace("0.1 0 0", ".1 0. +0E0"),
        text().trim_end().to_owned(),
    ];
    for variant in variants {
        assert!(same(&read(variant.as_bytes()).unwrap(), &plain), "{variant}");
    }
}

#[test]
fn strips_end_at_minus_one() {
    let strips = text()
        .replace("element face 2", "element tristrips 1")
        .replace("3 2 1 0\n4 0 1 2 3\n", "9 0 1 3 2 -1 2 1 0 -1\n");
    let raw = read(strips.as_bytes()).unwrap();
    assert_eq!(raw.triangles, [[0, 1, 3], [1, 2, 3], [2, 1, 0]]);
    assert_eq!(raw.triangle_place(2), Some(Place::Line(15)));
    let (place, message) = failure(strips.replace("2 -1 2", "2 -2 2").as_bytes());
    assert_eq!(place, Some(Place::Line(15)));
    assert!(message.contains("vertex index -2"), "{message}");
}

#[test]
fn point_clouds_have_no_triangles() {
    let (header, _) = HEADER.split_once("element face").unwrap();
    let cloud = format!("{header}end_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n");
    let raw = read(cloud.as_bytes()).unwrap();
    assert_eq!((raw.positions.len(), raw.triangles.len()), (4, 0));
    let none = text().replace("face 2", "face 0").replace("3 2 1 0\n4 0 1 2 3\n", "");
    assert!(read(none.replace("vertex_indices", "other").as_bytes()).unwrap().triangles.is_empty());
}

#[test]
fn text_errors_name_the_line() {
    let cases = [
        ("0.1 0 0", "0,1 0 0", 12, "cannot read `0,1` as a number"),
        ("0.1 0 0", "0.1 0", 12, "in the middle of its vertex"),
        ("0.1 0 0", "0.1 0 0 1", 12, "more numbers than the header gives a vertex"),
        ("3 2 1 0", "3 2 1", 15, "in the middle of its face"),
        ("3 2 1 0", "3 2 1 4", 15, "vertex index 4 is out of range: there are 4 vertices"),
        ("3 2 1 0", "3 2 1 -1", 15, "vertex index -1"),
        ("3 2 1 0", "-3 2 1 0", 15, "cannot read `-3` as a count"),
        ("3 2 1 0", "3 2 1 0.0", 15, "cannot read `0.0` as an integer"),
        ("4 0 1 2 3\n", "", 15, "promises 2 face entries"),
        ("face 2", "face 1", 16, "follows all that the header promises"),
        ("face 2", "face 4000000000", 16, "promises 4000000000 face entries"),
        ("face 2", "face -2", 8, "cannot read `-2` as a count"),
        ("face 2", "face", 8, "cannot read `` as a count"),
        ("float x", "float", 5, "a name is missing"),
        ("float x", "half x", 5, "there is no type `half`"),
        ("float x", "float a", 4, "its element `vertex` has no property `x`"),
        ("float x", "float y", 4, "has no property `x`"),
        ("float z", "float z\nproperty int x", 4, "has the property `x` twice"),
        ("vertex_indices", "indices", 8, "its element `face` has no property `vertex_indices`"),
        ("element face", "element vertex", 8, "two elements `vertex`"),
        ("element vertex 4\n", "", 4, "a property before any element"),
        ("format ascii 1.0\n", "", 9, "there is no `format` line"),
        ("ascii", "binary", 2, "there is no format `binary`"),
        ("comment by", "remark by", 3, "no keyword `remark`"),
    ];
    for (from, to, number, expected) in cases {
        let (place, message) = failure(text().replacen(from, to, 1).as_bytes());
        assert!(message.contains(expected), "{to}: {message}");
        assert_eq!(place, Some(Place::Line(number)), "{to}: {message}");
    }
    let (place, message) = failure(b"ply\nformat ascii 1.0\nelement vertex 3\n");
    assert_eq!(place, Some(Place::Line(3)));
    assert!(message.contains("ends before `end_header`"), "{message}");
}

#[test]
fn binary_errors_name_the_entry() {
    let whole = binary("binary_little_endian");
    let body = whole.windows(12).position(|w| w == b"end_header\r\n").unwrap() + 12;
    for cut in body..whole.len() {
        let (place, message) = failure(&whole[..cut]);
        assert!(message.contains("the file ends here, but promises"), "{cut}: {message}");
        assert!(place.is_some());
    }
    assert_eq!(failure(&whole[..whole.len() - 1]).0, Some(Place::Vertex(3)));
    let mut longer = whole.clone();
    longer.push(1);
    assert!(failure(&longer).1.contains("1 bytes follow"));
    let mut damaged = whole;
    // The first corner of the first face: material 0 takes 3 bytes, material 1 takes 19, the flag and the count 2.
    damaged[body + 24] = 200;
    let (place, message) = failure(&damaged);
    assert_eq!(place, Some(Place::Face(0)));
    assert!(message.contains("vertex index 200 is out of range"), "{message}");
}
