use super::*;

fn triangles_of(bytes: &[u8], ending: &str) -> Result<SoupMesh, BuildError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(format!("mesh.{ending}"));
    std::fs::write(&path, bytes).unwrap();
    read_mesh(&path)
}

#[test]
fn obj_reads_polygons_negative_numbers_and_any_line_ending() {
    let text = b"# a\r\nv 0 0 0\rv 1 0 0\nv 1 1 0 1.0\r\nv 0 1e0 0 # end\n\
        f 1/1/1 2//2 3/3 4\nf -4 -3 \\\n-2\nf 1 2 99\nf 0 1 2\nusemtl x\n";
    let mesh = triangles_of(text, "OBJ").unwrap();
    assert_eq!(mesh.positions.len(), 4);
    assert_eq!(mesh.positions[3], [0.0, 1.0, 0.0]);
    let beyond = u32::MAX;
    assert_eq!(
        mesh.triangles,
        [[0, 1, 2], [0, 2, 3], [0, 1, 2], [0, 1, 98], [beyond, 0, 1]]
    );
}

#[test]
fn a_broken_line_is_named() {
    let error = triangles_of(b"v 0 0 0\n\nv 1 zwei 3\n", "obj").unwrap_err();
    assert_eq!(
        error.to_string(),
        "line 3: \"v 1 zwei 3\" is no vertex: correct or delete it"
    );
    let error = triangles_of(b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1\n", "off").unwrap_err();
    assert!(error.to_string().starts_with("line 6:"), "{error}");
}

#[test]
fn off_reads_with_counts_on_either_line() {
    for head in ["OFF\n", "OFF ", "# c\nCOFF\n\n"] {
        let text = format!("{head}4 1 0\n0 0 0 9 9\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3 255 0 0\n");
        let mesh = triangles_of(text.as_bytes(), "off").unwrap();
        assert_eq!(mesh.positions.len(), 4);
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
    }
}

#[test]
fn a_huge_count_in_a_short_file_is_an_error_and_no_memory() {
    assert!(triangles_of(b"OFF\n99999999999 1 0\n", "off").is_err());
    let ply = b"ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\n\
        property float x\nproperty float y\nproperty float z\nend_header\nabcd";
    assert!(triangles_of(ply, "ply").is_err());
    let mut stl = vec![0u8; 84];
    stl[80..84].copy_from_slice(&u32::MAX.to_le_bytes());
    assert!(triangles_of(&stl, "stl").is_err());
}

#[test]
fn ply_reads_alike_as_text_and_in_both_byte_orders() {
    let head = |format: &str| {
        format!(
            "ply\nformat {format} 1.0\nelement vertex 4\nproperty double x\nproperty float y\n\
             property float z\nproperty uchar red\nelement extra 1\nproperty int tag\nelement face 1\n\
             property list uchar int vertex_indices\nend_header\n"
        )
    };
    let positions = [
        [0.1, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [1.0, 1.0, 0.5],
        [0.0, 1.0, 0.0],
    ];
    let mut text = head("ascii");
    for [x, y, z] in positions {
        text += &format!("{x} {y} {z} 7\n");
    }
    text += "5\n4 0 1 2 3\n";
    let expected = triangles_of(text.as_bytes(), "ply").unwrap();
    assert_eq!(expected.positions, positions);
    assert_eq!(expected.triangles, [[0, 1, 2], [0, 2, 3]]);
    for little in [true, false] {
        let mut bytes = head(if little {
            "binary_little_endian"
        } else {
            "binary_big_endian"
        })
        .into_bytes();
        let mut put = |little_endian: &[u8]| {
            let mut order = little_endian.to_vec();
            if !little {
                order.reverse();
            }
            bytes.extend(order);
        };
        for [x, y, z] in positions {
            put(&f64::to_le_bytes(x));
            put(&(y as f32).to_le_bytes());
            put(&(z as f32).to_le_bytes());
            put(&[7]);
        }
        put(&5i32.to_le_bytes());
        put(&[4]);
        for corner in 0..4i32 {
            put(&corner.to_le_bytes());
        }
        assert_eq!(triangles_of(&bytes, "ply").unwrap(), expected);
    }
}

#[test]
fn stl_reads_text_of_several_solids_and_binary_that_starts_like_text() {
    let facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 -0\n\
        endloop\nendfacet\n";
    let text = format!("solid a\n{facet}endsolid a\nsolid b\n{facet}endsolid b\n");
    let mesh = triangles_of(text.as_bytes(), "stl").unwrap();
    assert_eq!(mesh.positions.len(), 3);
    assert_eq!(mesh.triangles, [[0, 1, 2], [0, 1, 2]]);

    let mut binary = b"solid but binary".to_vec();
    binary.resize(80, b' ');
    binary.extend(1u32.to_le_bytes());
    for x in [0f32, 0., 1., 0., 0., 0., 1., 0., 0., 0., 1., 0.] {
        binary.extend(x.to_le_bytes());
    }
    binary.extend([0, 0]);
    let mesh = triangles_of(&binary, "stl").unwrap();
    assert_eq!(mesh.triangles, [[0, 1, 2]]);
    binary.pop();
    assert!(triangles_of(&binary, "stl").is_err());
}
