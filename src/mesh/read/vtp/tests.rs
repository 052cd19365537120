use super::*;
use crate::mesh::error::Place;

const TEXT: &str = "<?xml version=\"1.0\"?>\n<VTKFile type=\"PolyData\" version=\"0.1\" byte_order=\"BigEndian\">\n\
    <PolyData>\n<FieldData><DataArray type=\"String\" Name=\"a\" format=\"ascii\">1 2</DataArray></FieldData>\n\
    <Piece NumberOfPoints=\"5\" NumberOfVerts=\"1\" NumberOfLines=\"0\" NumberOfStrips=\"1\" NumberOfPolys=\"2\">\n\
    <PointData Scalars=\"s\"><DataArray type=\"Bit\" Name=\"s\" format=\"weird\"/></PointData>\n\
    <Points>\n<DataArray type=\"Float32\" Name=\"Points\" NumberOfComponents=\"3\" format=\"ascii\">\n\
    <InformationKey name=\"n\">9</InformationKey>\n\
    0 0 0 0.1 0 0\n1 1 0\n0 1 0 2 2 0\n</DataArray>\n</Points>\n\
    <Verts><DataArray type=\"Int64\" Name=\"connectivity\">3</DataArray>\
    <DataArray type=\"Int64\" Name=\"offsets\">1</DataArray></Verts>\n\
    <Strips><DataArray type=\"Int32\" Name=\"connectivity\">0 1 3 2</DataArray>\
    <DataArray type=\"Int32\" Name=\"offsets\">4</DataArray></Strips>\n\
    <Polys>\n<DataArray type=\"Int32\" Name=\"connectivity\" format=\"ascii\">\n2 1 0\n0 1 2 3\n</DataArray>\n\
    <DataArray type=\"Int32\" Name=\"offsets\" format=\"ascii\">\n3 7\n</DataArray>\n</Polys>\n\
    </Piece>\n</PolyData>\n</VTKFile>\n";

fn failure(text: &str) -> (Option<Place>, String) {
    let failure = read(text.as_bytes()).unwrap_err();
    (failure.place, failure.fault.to_string())
}

#[test]
fn text_keeps_its_digits_and_its_lines() {
    let raw = read(TEXT.as_bytes()).unwrap();
    assert_eq!(raw.positions[1], [0.1, 0.0, 0.0]);
    assert_eq!(raw.triangles, [[2, 1, 0], [0, 1, 2], [0, 2, 3], [0, 1, 3], [1, 2, 3]]);
    let line = |number| Some(Place::Line(number));
    assert_eq!((raw.position_place(1), raw.position_place(4)), (line(10), line(12)));
    assert_eq!((raw.triangle_place(0), raw.triangle_place(1)), (line(19), line(20)));
    assert_eq!((raw.polygons.len(), raw.left_out.len()), (1, 1));
}

#[test]
fn pieces_are_one_mesh_each_with_indices_of_its_own() {
    let (head, piece) = TEXT.split_once("<Piece").unwrap();
    let (piece, tail) = piece.split_once("</Piece>").unwrap();
    let twice = format!("{head}<Piece{piece}</Piece><Piece{piece}</Piece>{tail}");
    let raw = read(twice.as_bytes()).unwrap();
    assert_eq!((raw.positions.len(), raw.triangles.len()), (10, 10));
    assert_eq!(raw.triangles[5], [7, 6, 5]);
}

#[test]
fn what_is_not_read_is_named_with_its_remedy() {
    let with = |from: &str, to: &str| failure(&TEXT.replacen(from, to, 1)).1;
    let grid = with("\"PolyData\"", "\"UnstructuredGrid\"");
    assert!(grid.contains("UnstructuredGrid") && grid.contains("Extract Surface"), "{grid}");
    let lz4 = with("version=\"0.1\"", "compressor=\"vtkLZ4DataCompressor\"");
    assert!(lz4.contains("vtkLZ4DataCompressor") && lz4.contains("zlib"), "{lz4}");
}

#[test]
fn errors_name_the_line() {
    let cases = [
        ("0.1 0 0", "0,1 0 0", 10, "cannot read `0,1` as a number"),
        ("2 2 0\n", "2 2\n", 12, "the file ends here"),
        ("2 2 0\n", "2 2 0 7\n", 12, "this line follows"),
        ("NumberOfPoints=\"5\"", "NumberOfPoints=\"-5\"", 5, "`-5` as a count"),
        ("NumberOfPoints=\"5\"", "NumberOfPoints=\"4000000000\"", 8, "far larger than the file"),
        ("NumberOfComponents=\"3\"", "NumberOfComponents=\"2\"", 8, "2 coordinates"),
        ("2 1 0\n", "2 1 5\n", 19, "vertex index 5 is out of range: there are 5 vertices"),
        ("2 1 0\n", "2 1 -1\n", 19, "vertex index -1"),
        ("\n3 7\n", "\n7 3\n", 23, "do not ascend"),
        ("\n3 7\n", "\n3 8\n", 20, "the file ends here"),
        ("BigEndian", "Middle", 2, "the byte_order `Middle` is unknown"),
        ("Float32", "Float16", 8, "the type `Float16` is unknown"),
        ("<Points>", "<Pints>", 5, "the piece has no Points"),
        ("<Polys>", "<Poly>", 5, "2 cells are promised without their `connectivity`"),
        ("format=\"ascii\">\n3 7", "format=\"appended\">\n3 7", 22, "nothing is"),
    ];
    for (from, to, number, expected) in cases {
        let (place, message) = failure(&TEXT.replacen(from, to, 1));
        assert!(message.contains(expected), "{to}: {message}");
        assert_eq!(place, Some(Place::Line(number)), "{to}: {message}");
    }
    let (_, message) = failure(&TEXT.replace("</VTKFile>", ""));
    assert!(message.contains("the file ends here"), "{message}");
}

/// A file of one triangle, whose points stand in base64 after this start of a tag.
fn inline(header: &str, points: &str) -> String {
    format!(
        "<VTKFile type=\"PolyData\" {header}><PolyData><Piece NumberOfPoints=\"3\" NumberOfPolys=\"1\"><Points>\
         <DataArray type=\"Float32\" NumberOfComponents=\"3\" format=\"binary\">{points}</DataArray></Points>\
         <Polys><DataArray type=\"UInt8\" Name=\"connectivity\">0 1 2</DataArray>\
         <DataArray type=\"UInt8\" Name=\"offsets\">3</DataArray></Polys></Piece></PolyData></VTKFile>"
    )
}

#[test]
fn headers_of_arrays_that_lie_are_errors() {
    use ::base64::{Engine, engine::general_purpose::STANDARD};
    let points: Vec<u8> =
        [0_f32, 0., 0., 1., 0., 0., 0., 1., 0.].iter().flat_map(|c| c.to_le_bytes()).collect();
    let encode = |header: &[u32], data: &[u8]| {
        let header: Vec<u8> = header.iter().flat_map(|word| word.to_le_bytes()).collect();
        STANDARD.encode([&header, data].concat())
    };
    assert_eq!(read(inline("", &encode(&[36], &points)).as_bytes()).unwrap().positions.len(), 3);
    let message = |header: &str, text: &str| failure(&inline(header, text)).1;
    assert!(message("", &encode(&[35], &points)).contains("holds 35 bytes where 36 are promised"));
    assert!(message("", &encode(&[36], &points[1..])).contains("the file ends here"));
    let zlib = "compressor=\"vtkZLibDataCompressor\"";
    let blocks = u32::MAX;
    assert!(message(zlib, &encode(&[blocks, 1, 0], &points)).contains("bytes where 36"));
    assert!(message(zlib, &encode(&[36, 1, 0], &points)).contains("the file ends here"));
    assert!(message(zlib, &encode(&[1, 36, 0, 36], &points)).contains("block 0"));
}
