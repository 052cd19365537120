use super::*;

fn failure(text: &str) -> (Option<Place>, String) {
    let failure = read(text.as_bytes()).unwrap_err();
    (failure.place, failure.fault.to_string())
}

const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

#[test]
fn positions_keep_the_order_of_the_file_and_triangles_their_lines() {
    // The second group uses the vertices backwards, and vertex 2 is used by no face.
    let text = format!("{SQUARE}v 9 9 9\ng b\nf 4 3 1\no c\nusemtl m\nf 1 3 5\n");
    let raw = read(text.as_bytes()).unwrap();
    assert_eq!(raw.positions.len(), 5);
    assert_eq!(raw.positions[4], [9.0, 9.0, 9.0]);
    assert_eq!(raw.triangles, [[3, 2, 0], [0, 2, 4]]);
    assert_eq!(raw.position_place(4), Some(Place::Line(5)));
    assert_eq!(raw.triangle_place(1), Some(Place::Line(10)));
}

#[test]
fn faces_may_stand_before_the_vertices_they_use() {
    let raw = read(format!("f 3 2 1\n{SQUARE}f 1 3 4\n").as_bytes()).unwrap();
    assert_eq!(raw.triangles, [[2, 1, 0], [0, 2, 3]]);
    assert_eq!(raw.positions[1], [1.0, 0.0, 0.0]);
}

#[test]
fn small_files_keep_the_roll_call_apart_from_their_faces() {
    // One, two and three vertices make the roll call a point, a line and a triangle.
    let raw = read(b"v 0 0 0\n").unwrap();
    assert_eq!((raw.positions.len(), raw.triangles.len()), (1, 0));
    let raw = read(b"v 0 0 0\nv 1 0 0\nf 1 2\n").unwrap();
    assert_eq!((raw.positions.len(), raw.left_out.len()), (2, 1));
    let raw = read(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 3 2 1\n").unwrap();
    assert_eq!(raw.triangles, [[2, 1, 0]]);
    let raw = read(b"# none\n").unwrap();
    assert!(raw.positions.is_empty() && raw.triangles.is_empty());
}

#[test]
fn blanks_of_other_alphabets_part_no_numbers() {
    let (place, message) = failure(&format!("{SQUARE}v 0 0 0\u{a0}1\u{a0}1\nf 1 2 3\n"));
    assert_eq!(place, Some(Place::Line(5)));
    assert!(message.contains("cannot read `v 0 0 0"), "{message}");
}

#[test]
fn a_file_that_ends_in_a_face_is_cut_short() {
    for end in ["f", "f ", "f 3 4", "f 3/1 4/1", "f 3 \\\n4", "f 3 4 \\\n"] {
        let (place, message) = failure(&format!("{SQUARE}f 1 2 3\n{end}"));
        assert_eq!(place, Some(Place::Line(6)), "{end}");
        assert!(message.starts_with("the file ends here"), "{message}");
        if end.contains('\\') {
            continue;
        }
        // Whoever ends the line means it.
        assert_eq!(read(format!("{SQUARE}f 1 2 3\n{end}\n").as_bytes()).unwrap().left_out.len(), 1);
    }
    assert!(read(format!("{SQUARE}f 1 2 3\nf 1 3 4").as_bytes()).is_ok());
}

#[test]
fn seams_do_not_cut() {
    let text = format!("{SQUARE}vt 0 0\nvt 1 1\nvn 0 0 1\nf 1/1/1 2/2/1 3/1/1\nf 1/2 3/2 4//1\n");
    let raw = read(text.as_bytes()).unwrap();
    assert_eq!(raw.triangles, [[0, 1, 2], [0, 2, 3]]);
}

#[test]
fn negative_indices_count_from_the_line_they_stand_on() {
    let raw = read(format!("{SQUARE}f -4 -3 -2\nv 5 5 5\nf -1 -2 -3\n").as_bytes()).unwrap();
    assert_eq!(raw.triangles, [[0, 1, 2], [4, 3, 2]]);
}

#[test]
fn polygons_become_fans_and_lines_are_left_out() {
    let text = format!("{SQUARE}v 0 .5 0\nf 1 2 3 4 5\nl 1 2 3\np 1\nf 1 2\nf 1 2 3 4\n");
    let raw = read(text.as_bytes()).unwrap();
    assert_eq!(raw.triangles, [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 1, 2], [0, 2, 3]]);
    assert_eq!(raw.polygons, [Place::Line(6), Place::Line(10)]);
    assert_eq!(raw.left_out, [Place::Line(7), Place::Line(8), Place::Line(9)]);
    assert_eq!(raw.triangle_place(3), Some(Place::Line(10)));
}

#[test]
fn what_is_no_geometry_cannot_fail_the_file() {
    // tobj alone refuses one-dimensional vt, an unnamed material, colours on some vertices, a comment after
    // a face.
    let text =
        b"mtllib\nusemtl\nvt 1\nvn x\nv 0 0 0 1 1 1\nv 1 0 0\nv 0 1 0 1 1 1 1\nf 1 2 3 # \xff\n";
    assert_eq!(read(text).unwrap().triangles, [[0, 1, 2]]);
}

#[test]
fn numbers_are_read_as_doubles_and_w_divides() {
    let raw = read(b"v 0.1 1e-300 -0 2\nv 1 2 3 1\nv 4 5 6\nf 1 2 3\n").unwrap();
    assert_eq!(raw.positions[0], [0.05, 0.5e-300, 0.0]);
    assert_eq!(raw.positions[1], [1.0, 2.0, 3.0]);
}

#[test]
fn errors_name_the_line() {
    let (place, message) = failure("v 0 0 0\n\nv 1,5 0 0\n");
    assert_eq!(place, Some(Place::Line(3)));
    assert!(message.contains("`v 1,5 0 0`") && message.contains("decimal point"));

    assert_eq!(failure("v 0 0\n").0, Some(Place::Line(1)));
    assert_eq!(failure(&format!("{SQUARE}f 1 2 x\n")).0, Some(Place::Line(5)));
    assert_eq!(failure("v 0 0 0\nv 1 1 1 0\n").0, Some(Place::Line(2)));
    assert_eq!(read(b"v \xff 0 0\n").unwrap_err().place, Some(Place::Line(1)));
}

#[test]
fn indices_out_of_range_name_the_line_and_the_index() {
    for (face, index) in [("f 1 2 5", 5), ("f 1 2 0", 0), ("f 1 2 -5", -5)] {
        let (place, message) = failure(&format!("{SQUARE}f 1 2 3\n{face}\n"));
        assert_eq!(place, Some(Place::Line(6)), "{face}");
        let expected = format!("vertex index {index} is out of range: there are 4 vertices");
        assert!(message.contains(&expected), "{message}");
    }
    assert_eq!(failure("f 1 2 3\n").0, Some(Place::Line(1)));
    // No position index at all.
    assert_eq!(failure(&format!("{SQUARE}f /1 2 3\n")).0, Some(Place::Line(5)));
}
