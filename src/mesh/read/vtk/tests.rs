use super::*;

const TEXT: &str = "# vtk DataFile Version 3.0\nPOINTS of a title\nASCII\nDATASET POLYDATA\nPOINTS 5 float\n\
    0 0 0 0.1 0 0\n1 1 0\n0 1 0 2 2 0\nPOLYGONS 2 9\n3 2 1 0\n4 0 1 2 3\nTRIANGLE_STRIPS 1 5\n4 0 1 3 2\n\
    CELL_DATA 3\nSCALARS a float\nLOOKUP_TABLE default\n1 2 3\n";

const TRIANGLES: [[u32; 3]; 5] = [[2, 1, 0], [0, 1, 2], [0, 2, 3], [0, 1, 3], [1, 2, 3]];

fn failure(bytes: &[u8]) -> (Option<Place>, String) {
    let failure = read(bytes).unwrap_err();
    (failure.place, failure.fault.to_string())
}

fn ints(numbers: &[i32]) -> Vec<u8> {
    numbers.iter().flat_map(|n| n.to_be_bytes()).collect()
}

fn longs(numbers: &[i64]) -> Vec<u8> {
    numbers.iter().flat_map(|n| n.to_be_bytes()).collect()
}

fn joined(parts: &[&[u8]]) -> Vec<u8> {
    parts.concat()
}

/// The mesh of `TEXT` in bytes, the cells in `cells`.
fn binary(cells: &[u8]) -> Vec<u8> {
    let points = [[0., 0., 0.], [0.1_f64, 0., 0.], [1., 1., 0.], [0., 1., 0.], [2., 2., 0.]];
    let points: Vec<u8> = points.iter().flatten().flat_map(|c| c.to_be_bytes()).collect();
    joined(&[
        b"# vtk DataFile Version 5.1\n\nBINARY\nDATASET POLYDATA\nFIELD FieldData 1\nTIME 1 1 double\n",
        &2.5_f64.to_be_bytes(),
        b"\nMETADATA\nINFORMATION 0\n\nPOINTS 5 double\n",
        &points,
        b"\nMETADATA\nINFORMATION 0\n\n",
        cells,
        b"\nPOINT_DATA 5\n\xff\xff",
    ])
}

fn classic() -> Vec<u8> {
    let polygons = ints(&[3, 2, 1, 0, 4, 0, 1, 2, 3]);
    let strips = ints(&[4, 0, 1, 3, 2]);
    joined(&[b"POLYGONS 2 9\n", &polygons, b"\nTRIANGLE_STRIPS 1 5\n", &strips])
}

fn vtk5() -> Vec<u8> {
    joined(&[
        b"POLYGONS 3 7\nOFFSETS vtktypeint64\n",
        &longs(&[0, 3, 7]),
        b"\nCONNECTIVITY vtktypeint64\n",
        &longs(&[2, 1, 0, 0, 1, 2, 3]),
        b"\nTRIANGLE_STRIPS 2 4\nOFFSETS int\n",
        &ints(&[0, 4]),
        b"\nCONNECTIVITY unsigned_char\n\x00\x01\x03\x02",
    ])
}

#[test]
fn text_keeps_its_digits_and_its_lines() {
    let raw = read(TEXT.as_bytes()).unwrap();
    assert_eq!(raw.positions[1], [0.1, 0.0, 0.0]);
    assert_eq!(raw.triangles, TRIANGLES);
    let line = |number| Some(Place::Line(number));
    assert_eq!((raw.position_place(1), raw.position_place(4)), (line(6), line(8)));
    assert_eq!((raw.triangle_place(2), raw.triangle_place(4)), (line(11), line(13)));
    assert_eq!(raw.polygons, [Place::Line(11)]);
}

#[test]
fn bytes_of_both_layouts_are_the_same_mesh() {
    let text = read(TEXT.as_bytes()).unwrap();
    for cells in [classic(), vtk5()] {
        let raw = read(&binary(&cells)).unwrap();
        assert_eq!((&raw.positions, &raw.triangles), (&text.positions, &text.triangles));
        assert_eq!(raw.position_place(1), Some(Place::Vertex(1)));
        assert_eq!(raw.triangle_place(2), Some(Place::Cell(1)));
        assert_eq!(raw.triangle_place(4), Some(Place::Cell(2)));
    }
}

#[test]
fn line_ends_capitals_and_the_layout_of_text_change_nothing() {
    let plain = read(TEXT.as_bytes()).unwrap();
    let variants = [
        TEXT.replace('\n', "\r\n"),
        TEXT.replace("POINTS of a title", ""),
        TEXT.replace("POLYDATA", "polydata").replace("float", "DOUBLE"),
        TEXT.replace("POLYGONS 2 9", "METADATA\nINFORMATION 1\nNAME a LOCATION b\n\nPOLYGONS 2 9"),
        TEXT.replace("POINTS 5", "FIELD f 2\na 2 2 int\n1 2\n3 4\nb 1 0 float\nPOINTS 5"),
        TEXT.replace("3 2 1 0\n4 0 1 2 3\n", "3 2\n1 0 4 0\n1 2\t3\n"),
        TEXT.replace(
            "2 9\n3 2 1 0\n4 0 1 2 3\n",
            "3 7\nOFFSETS vtktypeint64\n0 3 7\nCONNECTIVITY int\n2 1 0 0 1\n2 3\n",
        ),
    ];
    for variant in variants {
        let raw = read(variant.as_bytes()).unwrap();
        assert_eq!(
            (&raw.positions, &raw.triangles),
            (&plain.positions, &plain.triangles),
            "{variant}"
        );
    }
}

#[test]
fn vertices_and_lines_are_left_out() {
    let text = TEXT.replace("POLYGONS", "VERTICES 1 2\n1 0\nLINES 1 4\n3 0 1 2\nPOLYGONS");
    let raw = read(text.as_bytes()).unwrap();
    assert_eq!(raw.triangles, TRIANGLES);
    assert_eq!(raw.left_out, [Place::Line(10), Place::Line(12)]);
    let cells = joined(&[b"LINES 1 3\n", &ints(&[2, 0, 1]), b"\n", &classic()]);
    let raw = read(&binary(&cells)).unwrap();
    assert_eq!(raw.left_out, [Place::Cell(0)]);
    assert_eq!(raw.triangle_place(0), Some(Place::Cell(1)));
}

fn grid(cells: &str, types: &str) -> String {
    let (head, _) = TEXT.split_once("POLYGONS").unwrap();
    format!("{head}{cells}\n{types}\n").replace("POLYDATA", "UNSTRUCTURED_GRID")
}

#[test]
fn flat_grids_are_surfaces_and_volumes_are_refused() {
    let cells = "CELLS 5 20\n3 2 1 0\n4 0 1 3 2\n4 0 1 2 3\n4 0 1 3 2\n0";
    let raw = read(grid(cells, "CELL_TYPES 5\n5 8 9 6 0").as_bytes()).unwrap();
    let quads = [[0, 1, 2], [0, 2, 3]];
    assert_eq!(raw.triangles[0], [2, 1, 0]);
    assert_eq!((&raw.triangles[1..3], &raw.triangles[3..5]), (&quads[..], &quads[..]));
    assert_eq!(raw.triangles[5..], [[0, 1, 3], [1, 2, 3]]);
    assert_eq!(raw.left_out, [Place::Line(14)]);
    let tetrahedra = grid(cells, "CELL_TYPES 5\n5 10 9 6 0");
    let (place, message) = failure(tetrahedra.as_bytes());
    assert_eq!(place, Some(Place::Line(16)));
    assert!(message.contains("cell type 10") && message.contains("Extract Surface"), "{message}");
    let message = failure(grid(cells, "CELL_TYPES 4\n5 9 9 9").as_bytes()).1;
    assert!(message.contains("4 CELL_TYPES for 5 CELLS"), "{message}");
    assert!(failure(grid(cells, "").as_bytes()).1.contains("no CELL_TYPES"));
    let volumes = TEXT.replace("POLYDATA", "STRUCTURED_POINTS");
    assert!(failure(volumes.as_bytes()).1.contains("the dataset STRUCTURED_POINTS is not read"));
}

#[test]
fn text_errors_name_the_line() {
    let cases = [
        ("0.1 0 0", "0,1 0 0", 6, "cannot read `0,1` as a number"),
        ("POINTS 5", "POINTS 4", 8, "`2` is not expected here"),
        ("POINTS 5", "POINTS 6", 9, "cannot read `POLYGONS` as a number"),
        ("POINTS 5", "POINTS -5", 5, "cannot read `-5` as a count"),
        ("POINTS 5 float", "POINTS 5", 5, "the data type ``"),
        ("POINTS 5 float", "POINTS 5 string", 5, "the data type `string`"),
        ("3 2 1 0\n", "3 2 1 5\n", 10, "vertex index 5 is out of range: there are 5 vertices"),
        ("3 2 1 0\n", "3 2 1 -1\n", 10, "vertex index -1"),
        ("3 2 1 0\n", "-3 2 1 0\n", 10, "cannot read `-3` as a count"),
        ("3 2 1 0\n", "3 2 1 x\n", 10, "cannot read `x` as an integer"),
        ("2 9", "2 8", 11, "take more than 8 numbers"),
        ("2 9", "2 10", 11, "take 1 fewer than 10 numbers"),
        ("POLYGONS 2", "POLYGONS 1", 10, "fewer than 9"),
        ("ASCII", "TEXT", 3, "neither ASCII nor BINARY"),
        ("DATASET ", "SET ", 4, "DATASET is expected"),
        ("POLYGONS", "TRIANGLES", 9, "`TRIANGLES` is not expected"),
    ];
    for (from, to, number, expected) in cases {
        let (place, message) = failure(TEXT.replacen(from, to, 1).as_bytes());
        assert!(message.contains(expected), "{to}: {message}");
        assert_eq!(place, Some(Place::Line(number)), "{to}: {message}");
    }
    let before = TEXT.replace("POINTS 5", "POLYGONS 1 4\n3 0 1 2\nPOINTS 5");
    assert!(failure(before.as_bytes()).1.contains("there are 0 vertices"));
}

#[test]
fn binary_counts_and_offsets_that_lie_are_errors() {
    for cells in [classic(), vtk5()] {
        let whole = binary(&cells);
        let end = whole.windows(10).position(|w| w == b"POINT_DATA").unwrap() - 1;
        let (place, message) = failure(&whole[..end - 1]);
        assert_eq!(place, Some(Place::Cell(2)));
        assert!(message.contains("the file ends here"), "{message}");
    }
    let text = |cells: &[u8]| failure(&binary(cells)).1;
    let offsets = |numbers: &[i64]| {
        let connectivity = longs(&[0, 1, 2, 0, 2, 3]);
        let numbers = longs(numbers);
        let keyword = b"\nCONNECTIVITY vtktypeint64\n";
        joined(&[b"POLYGONS 3 6\nOFFSETS vtktypeint64\n", &numbers, keyword, &connectivity])
    };
    assert!(read(&binary(&offsets(&[0, 3, 6]))).is_ok());
    assert!(text(&offsets(&[0, 4, 3])).contains("do not ascend"));
    assert!(text(&offsets(&[1, 3, 6])).contains("do not run from 0 to 6"));
    assert!(text(&offsets(&[0, 3, 7])).contains("do not run from 0 to 6"));
    assert!(text(&offsets(&[0, -3, 6])).contains("`-3` as a count"));
    assert!(
        text(&joined(&[b"POLYGONS 1 4\n", &ints(&[i32::MAX, 0, 1, 2])])).contains("more than 4")
    );
    let far = joined(&[b"POLYGONS 4000000000 16000000000\n", &ints(&[3, 0, 1, 2])]);
    assert!(text(&far).len() > 20);
}
