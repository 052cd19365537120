use super::*;

fn failure(text: &str) -> (Option<Place>, String) {
    let failure = read(text.as_bytes()).unwrap_err();
    (failure.place, failure.fault.to_string())
}

const SQUARE: &str = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n";

#[test]
fn vertices_faces_and_polygons_keep_their_order_and_lines() {
    let raw = read(format!("OFF\n4 2 5\n{SQUARE}3 2 1 0\n4 0 1 2 3\n").as_bytes()).unwrap();
    assert_eq!(raw.positions, [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]]);
    assert_eq!(raw.triangles, [[2, 1, 0], [0, 1, 2], [0, 2, 3]]);
    assert_eq!((raw.position_place(3), raw.triangle_place(0)), (line(6), line(7)));
    assert_eq!(raw.polygons, [Place::Line(8)]);
}

fn line(number: u32) -> Option<Place> {
    Some(Place::Line(number))
}

#[test]
fn headers_comments_colours_and_blanks_change_nothing() {
    let plain = read(format!("OFF\n4 2 0\n{SQUARE}3 0 1 2\n3 0 2 3\n").as_bytes()).unwrap();
    let faces = "3 0 1 2\n3 0 2 3\n";
    let coloured = SQUARE.replace(" 0\n", " 0 0.5 0.5 0.5 1\n");
    let same = [
        format!("OFF 4 2 0\n{SQUARE}{faces}"),
        format!("OFF4 2 0\n{SQUARE}{faces}"),
        format!("4 2 0\n{SQUARE}{faces}"),
        format!("# by hand\n\n OFF # here\n# counts\n4 2\n\n{SQUARE}# faces\n{faces}# end\n\n"),
        format!("\u{feff}COFF\n4 2 0\n{coloured}3 0 1 2 255 0 0\n3\t0 2 3   1 0 0 .5 # red\n"),
        format!("STCNOFF\n4 2 0\n{coloured}{faces}"),
        format!("OFF\n4 2 0\n{SQUARE}{faces}").replace('\n', " \t\r\n"),
        format!("OFF\n4 2 0\n{SQUARE}{faces}").trim_end().to_owned(),
    ];
    for text in same {
        let raw = read(text.as_bytes()).unwrap();
        assert_eq!(
            (raw.positions, raw.triangles),
            (plain.positions.clone(), plain.triangles.clone())
        );
    }
}

#[test]
fn faces_of_fewer_than_three_corners_are_left_out() {
    let raw = read(format!("OFF\n4 4 0\n{SQUARE}0\n1 0\n2 0 1\n3 0 1 2\n").as_bytes()).unwrap();
    assert_eq!(raw.left_out, [Place::Line(7), Place::Line(8), Place::Line(9)]);
    assert_eq!(raw.triangles.len(), 1);
}

#[test]
fn errors_name_the_line_and_the_reason() {
    let all = format!("OFF\n4 1 0\n{SQUARE}3 0 1 2\n");
    let cases = [
        ("1 1 0", "1 1,5 0", 5, "cannot read `1,5` as a number"),
        ("1 1 0", "1 1", 5, "in the middle of its vertex"),
        ("3 0 1 2", "3 0 1", 7, "in the middle of its face"),
        ("3 0 1 2", "3 0 1 4", 7, "vertex index 4 is out of range: there are 4 vertices"),
        ("3 0 1 2", "3 0 1 -1", 7, "vertex index -1 is out of range"),
        ("3 0 1 2", "3 0 1 1.0", 7, "cannot read `1.0` as an integer"),
        ("3 0 1 2", "-3 0 1 2", 7, "cannot read `-3` as a count"),
        ("3 0 1 2\n", "", 6, "the file ends here, but promises 1 face entries"),
        ("4 1 0", "4 2 0", 7, "promises 2 face entries"),
        ("4 1 0", "4 0 0", 7, "this line follows all that the header promises"),
        ("4 1 0", "3 1 0", 7, "this line follows all that the header promises"),
        ("4 1 0", "4000000000 1 0", 7, "promises 4000000000 vertex entries"),
        ("4 1 0", "-4 1 0", 2, "cannot read `-4` as a count"),
        ("4 1 0", "4", 2, "counts of vertices and faces are missing"),
        ("OFF", "4OFF", 1, "four or more coordinates"),
        ("OFF", "nOFF 5", 1, "four or more coordinates"),
        ("OFF", "OFF BINARY", 1, "binary OFF is not read; export it as text"),
    ];
    for (from, to, number, expected) in cases {
        let (place, message) = failure(&all.replacen(from, to, 1));
        assert!(message.contains(expected), "{to}: {message}");
        assert_eq!(place, line(number), "{to}: {message}");
    }
    assert!(failure("OFF\n").1.contains("missing"));
    assert!(failure("# nothing\n").1.contains("the file ends here"));
}
