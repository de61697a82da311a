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
    stl[80..84].copy_from_slice(&(u32::MAX - 1).to_le_bytes());
    assert!(triangles_of(&stl, "stl").is_err());
}

#[test]
fn ply_reads_alike_as_text_and_in_both_byte_orders() {
    let head = |format: &str| {
        format!(
            "ply\nformat {format} 1.0\nelement vertex 4\nproperty double x\nproperty float y\n\
             property float z\nproperty uchar red\nelement extra 1\nproperty int tag\n\
             element face 1\nproperty list uchar int vertex_indices\nend_header\n"
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

/// A kerb of 15 cm in metres of a national grid; and noise where others write 0. A facet of nothing
/// but zeros tells nothing of where the model lies.
#[test]
fn stl_far_from_its_origin_keeps_every_bit_and_its_own_corners() {
    for (origin, noise) in [([4e5, 5.6e6, 120.0], 0.0), ([0.0; 3], 1e-17)] {
        let vertex = |p: [f64; 3], noise: f64| {
            let [x, y, z] = [0, 1, 2].map(|k| origin[k] + p[k] + noise);
            format!("vertex {x:.20} {y:.20} {z:.20}\n")
        };
        let face = |corners: [[f64; 3]; 3], noise: f64| {
            let corners = corners.map(|p| vertex(p, noise)).concat();
            format!("facet normal 0 0 1\nouter loop\n{corners}endloop\nendfacet\n")
        };
        let (a, b, c) = ([0.0, 0.123, 0.0], [10.0, 0.0, 0.0], [0.0, 0.123, 0.15]);
        let text = face([a, b, c], 0.0) + &face([b, a, [7.0, 9.0, 1.0]], noise);
        let corner = "vertex 0 0 0\n".repeat(3);
        let null = format!("facet normal 0 0 0\nouter loop\n{corner}endloop\nendfacet\n");
        for nulls in [0, 1] {
            let text = format!("solid kerb\n{text}{}endsolid\n", null.repeat(nulls));
            let mesh = triangles_of(text.as_bytes(), "stl").unwrap();
            let expected: [[u32; 3]; 3] = [[0, 1, 2], [1, 0, 3], [4, 4, 4]];
            assert_eq!(mesh.triangles, expected[..2 + nulls], "{origin:?}");
            let there = [0, 1, 2].map(|k| origin[k] + a[k]);
            assert_eq!(mesh.positions[0], there);
        }
    }
}

/// At the size of the one that is far out all others would be smaller than the last bit.
#[test]
fn a_facet_far_out_in_an_stl_leaves_the_others_their_corners() {
    let facet = |corners: [[f64; 3]; 3]| {
        let corners = corners.map(|[x, y, z]| format!("vertex {x:e} {y:e} {z:e}\n"));
        let corners = corners.concat();
        format!("facet normal 0 0 1\nouter loop\n{corners}endloop\nendfacet\n")
    };
    let mut sheet = String::new();
    for (i, j) in (0..10).flat_map(|i| (0..10).map(move |j| (i, j))) {
        let at =
            |i: i32, j: i32, noise: f64| [0.1 * f64::from(i) + noise, 0.1 * f64::from(j), noise];
        sheet += &facet([at(i, j, 0.0), at(i + 1, j, 0.0), at(i + 1, j + 1, 0.0)]);
        // With noise where the other facet has 0.
        sheet += &facet([
            at(i, j, 1e-17),
            at(i + 1, j + 1, 1e-17),
            at(i, j + 1, 1e-17),
        ]);
    }
    for far in [10.0, 1e4, 1e9, 1e30] {
        let outer = facet([[far, 0.0, 0.0], [far, far, 0.0], [0.0, far, far]]);
        let text = format!("solid sheet\n{sheet}{outer}endsolid\n");
        let mesh = triangles_of(text.as_bytes(), "stl").unwrap();
        assert_eq!(mesh.triangles.len(), 201);
        assert_eq!(mesh.positions.len(), 11 * 11 + 3, "{far:e}");
    }
}

/// Paths of Windows end so.
#[test]
fn a_comment_that_ends_in_a_backslash_leaves_the_next_line() {
    let obj = "# from C:\\models\\\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3 # C:\\\nf 3 2 \\\n1\n";
    let mesh = triangles_of(obj.as_bytes(), "obj").unwrap();
    assert_eq!(mesh.positions.len(), 3);
    assert_eq!(mesh.triangles, [[0, 1, 2], [2, 1, 0]]);
    let ply = "ply\nformat ascii 1.0\ncomment C:\\models\\\nelement vertex 3\nproperty float x\n\
        property float y\nproperty float z\nelement face 1\n\
        property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    let mesh = triangles_of(ply.as_bytes(), "ply").unwrap();
    assert_eq!((mesh.positions.len(), mesh.triangles.len()), (3, 1));
}

#[test]
fn polygons_are_cut_along_diagonals_that_lie_inside() {
    // An arrow whose second corner is reflex, in every format that has polygons; a fan would fold
    // over.
    let expected = [[0, 1, 3], [1, 2, 3]];
    let obj = "f 1 2 3 4\nv 0 0 0\nv 4 1 0\nv 8 0 0\nv 4 9 0\n";
    let off = "OFF 4 1 0\n0 0 0\n4 1 0\n8 0 0\n4 9 0\n4 0 1 2 3\n";
    let ply = "ply\nformat ascii 1.0\nelement face 1\nproperty list uchar int vertex_index\n\
        element vertex 4\nproperty int x\nproperty int y\nproperty int z\nend_header\n\
        4 0 1 2 3\n0 0 0\n4 1 0\n8 0 0\n4 9 0\n";
    for (text, ending) in [(obj, "obj"), (off, "off"), (ply, "ply")] {
        let mut mesh = triangles_of(text.as_bytes(), ending).unwrap();
        for triangle in &mut mesh.triangles {
            let least = (0..3).min_by_key(|&k| triangle[k]).unwrap();
            triangle.rotate_left(least);
        }
        mesh.triangles.sort_unstable();
        assert_eq!(mesh.triangles, expected, "{ending}");
    }
}

#[test]
fn marks_comments_and_printers_of_not_a_number_are_no_obstacle() {
    let text = b"\xef\xbb\xbf# \xe9 in Latin-1\nv nan -nan(ind) 1\nv inf 0 0\nv 0 0 0\nf 1 2 3\n";
    let mesh = triangles_of(text, "obj").unwrap();
    assert!(mesh.positions[0][0].is_nan() && mesh.positions[0][1].is_nan());
    assert_eq!(mesh.triangles, [[0, 1, 2]]);
    let error = triangles_of(b"\xff\xfev\0 \0", "obj").unwrap_err();
    assert!(error.to_string().contains("UTF-16"), "{error}");
}

#[test]
fn off_takes_every_keyword_of_a_text() {
    let body = "1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n";
    for head in [
        "STCNOFF\n3 1 0\n",
        "OFF3 1 0\n",
        "3 1 0\n",
        "\n# c\nNOFF 3 1\n",
    ] {
        let mesh = triangles_of(format!("{head}{body}").as_bytes(), "off").unwrap();
        assert_eq!(mesh.triangles, [[0, 1, 2]], "{head}");
    }
    for head in ["nOFF\n3 3 1 0\n", "4OFF\n3 1 0\n", "OFF BINARY\n", "BOFF\n"] {
        assert!(triangles_of(format!("{head}{body}").as_bytes(), "off").is_err());
    }
}

#[test]
fn ply_takes_lists_and_elements_of_any_type() {
    let head = "ply\r\nformat binary_big_endian 1.0\r\ncomment \u{e9}\r\nobj_info x\r\n\
        element camera 1\r\nproperty list ushort double matrix\r\nproperty char c\r\n\
        element vertex 4\r\nproperty list int8 float t\r\nproperty float64 z\r\n\
        property int16 y\r\nproperty uint x\r\n\
        element tristrips 1\r\nproperty list int int vertex_indices\r\n\
        element face 1\r\nproperty float quality\r\nproperty list uint ushort vertex_indices\r\nend_header\r\n";
    let mut bytes: Vec<u8> = head.chars().map(|c| c as u8).collect();
    bytes.extend(2u16.to_be_bytes());
    bytes.extend([0; 16]);
    bytes.push(7);
    for (t, x, y, z) in [
        (0u8, 0u32, -1i16, 0.5f64),
        (1, 1, 0, 0.0),
        (2, 2, 2, 1e9),
        (0, 3, 3, 3.0),
    ] {
        bytes.push(t);
        bytes.extend(vec![0; 4 * t as usize]);
        bytes.extend(z.to_be_bytes());
        bytes.extend(y.to_be_bytes());
        bytes.extend(x.to_be_bytes());
    }
    for number in [8i32, 0, 1, 2, 3, -1, 3, 2, 1] {
        bytes.extend(number.to_be_bytes());
    }
    bytes.extend(0.5f32.to_be_bytes());
    bytes.extend(3u32.to_be_bytes());
    for corner in [3u16, 0, 2] {
        bytes.extend(corner.to_be_bytes());
    }
    let mesh = triangles_of(&bytes, "ply").unwrap();
    assert_eq!(mesh.positions[0], [0.0, -1.0, 0.5]);
    assert_eq!(mesh.positions[2], [2.0, 2.0, 1e9]);
    assert_eq!(mesh.triangles, [[0, 1, 2], [2, 1, 3], [3, 2, 1], [3, 0, 2]]);
    for cut in 1..40 {
        let error = triangles_of(&bytes[..bytes.len() - cut], "ply").unwrap_err();
        assert!(error.to_string().contains("ends within"), "{error}");
    }
}

#[test]
fn ply_headers_end_in_any_line_ending() {
    for end in ["\n", "\r\n", "\r"] {
        let head = [
            "ply",
            "format binary_little_endian 1.0",
            "element face 1",
            "property list uchar uchar vertex_indices",
            "element vertex 1",
            "property uchar x",
            "property uchar y",
            "property uchar z",
            "end_header",
            "",
        ];
        let mut bytes = head.join(end).into_bytes();
        // A list of ten corners starts with the byte of a line feed.
        bytes.extend([10, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 2, 3]);
        let mesh = triangles_of(&bytes, "ply").unwrap();
        assert_eq!(mesh.triangles.len(), 8, "{end:?}");
        assert_eq!(mesh.positions, [[1.0, 2.0, 3.0]]);
    }
}

#[test]
fn bad_ply_headers_and_values_are_named_by_line() {
    let cases: [(&str, &str); 6] = [
        ("ply\nformat ascii 1.0\nelement vertex many\n", "line 3"),
        ("ply\nformat ascii 1.0\nproperty int x\n", "line 3"),
        (
            "ply\nformat ascii 1.0\nelement face 1\nproperty list float int vertex_indices\n",
            "line 4",
        ),
        (
            "ply\nformat ascii 1.0\nelement vertex 1\nproperty int x\nend_header\n1\n",
            "line 3",
        ),
        (
            "ply\nformat ascii 1.0\nelement vertex 1\nproperty int x\nproperty int y\nproperty int z\nend_header\n\n1 2\n",
            "line 9",
        ),
        (
            "ply\nformat ascii 1.0\nelement face 1\nproperty list int int vertex_indices\nend_header\n-1\n",
            "line 6",
        ),
    ];
    for (text, expected) in cases {
        let error = triangles_of(text.as_bytes(), "ply")
            .unwrap_err()
            .to_string();
        assert!(error.starts_with(expected), "{error}");
    }
}

#[test]
fn stl_of_an_unknown_count_is_as_long_as_it_is() {
    let mut binary = vec![0u8; 84];
    for k in 0..3u8 {
        let mut triangle = [0u8; 50];
        for (corner, at) in [12, 28, 44].into_iter().enumerate() {
            triangle[at..at + 4].copy_from_slice(&(f32::from(k) + corner as f32).to_le_bytes());
        }
        binary.extend(triangle);
    }
    for (announced, expected) in [
        (0u32, Some(3)),
        (u32::MAX, Some(3)),
        (2, Some(2)),
        (4, None),
    ] {
        binary[80..84].copy_from_slice(&announced.to_le_bytes());
        let faces = triangles_of(&binary, "stl")
            .ok()
            .map(|mesh| mesh.triangles.len());
        assert_eq!(faces, expected, "{announced}");
    }
}

#[test]
fn a_page_or_a_pointer_in_place_of_an_stl_is_not_taken_for_a_short_one() {
    let page = "<!DOCTYPE html>\n<html><head><title>Not found</title></head>\n<body>\n\t<p>\
        The file that you look for is not here.</p></body></html>\n";
    let pointer = format!(
        "version https://git-lfs.github.com/spec/v1\noid sha256:{}\nsize 1684084\n",
        "4d".repeat(32)
    );
    for text in [page, &pointer] {
        let error = triangles_of(text.as_bytes(), "stl").unwrap_err();
        let sentence = error.to_string();
        assert!(sentence.contains("nor a binary STL"), "{sentence}");
        assert!(!sentence.contains("announces"), "{sentence}");
    }
}

#[test]
fn a_polygon_that_is_too_large_is_named_by_its_number() {
    let half = crate::tuning::input::MAX_CORNERS / 2 + 1;
    // A zigzag and back again, beside itself.
    let there = (0..half).map(|k| format!("v {k} {} 0\n", 5 * (k % 2)));
    let back = (0..half).rev();
    let back = back.map(|k| format!("v {k} {}.3 0\n", 5 * (k % 2)));
    let vertices: String = there.chain(back).collect();
    let all: String = (1..=2 * half).map(|k| format!(" {k}")).collect();
    let text = format!("{vertices}f 1 2 3\nf 1 2 3 4\nf{all}\n");
    let error = triangles_of(text.as_bytes(), "obj").unwrap_err();
    let expected = format!("face 3 of this mesh is a polygon of {} corners", 2 * half);
    assert!(error.to_string().starts_with(&expected), "{error}");
}

#[test]
fn stl_texts_on_one_line_are_read_and_broken_ones_named() {
    let line = "SOLID a vertex\nFACET NORMAL 0 0 nan OUTER LOOP VERTEX 0 0 0 VERTEX 1 0 0 VERTEX 1 1 0 VERTEX 0 1 0 \
        ENDLOOP ENDFACET\nendsolid a loop";
    let mesh = triangles_of(line.as_bytes(), "stl").unwrap();
    assert_eq!(mesh.positions.len(), 4);
    assert_eq!(mesh.triangles.len(), 2);
    for (text, expected) in [
        ("solid\nfacet\nouter loop\nvertex 1 2\nendloop\n", "line 5"),
        ("solid\nvertex 1 2 3\n", "line 2"),
        (
            "solid\nfacet\nouter loop\nvertex 1 2 3\n",
            "ends within a face",
        ),
        ("solid\nDear reader\n", "line 2"),
    ] {
        let error = triangles_of(text.as_bytes(), "stl")
            .unwrap_err()
            .to_string();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn a_text_stl_that_is_cut_off_is_no_smaller_mesh() {
    let whole = include_bytes!("../../../tests/corpus/text.stl");
    assert_eq!(triangles_of(whole, "stl").unwrap().triangles.len(), 4);
    let end = whole.windows(8).rposition(|part| part == b"endsolid");
    let end = end.unwrap() + 8;
    for length in 0..end {
        let cut = read_mesh_bytes(&whole[..length], MeshFormat::Stl);
        assert!(cut.is_err(), "cut behind {length} bytes");
    }
    let behind_a_face = whole.windows(7).rposition(|part| part == b"endloop");
    let behind_a_face = behind_a_face.unwrap() + 7;
    let error = triangles_of(&whole[..behind_a_face], "stl").unwrap_err();
    let sentence = error.to_string();
    assert!(sentence.contains("ends before \"endsolid\""), "{sentence}");
    assert!(triangles_of(&whole[..end], "stl").is_ok(), "but its name");
}

#[test]
fn an_spm_text_that_is_cut_off_is_no_coarser_mesh() {
    let whole = include_bytes!("../../../tests/corpus/plate.spmtxt");
    assert_eq!(triangles_of(whole, "spmtxt").unwrap().triangles.len(), 72);
    let last = whole[..whole.len() - 1]
        .iter()
        .rposition(|&byte| byte == b'\n');
    let last = last.unwrap() + 1;
    for length in 0..=last {
        let cut = read_mesh_bytes(&whole[..length], MeshFormat::Thesis);
        assert!(cut.is_err(), "cut behind {length} bytes");
    }
    let error = triangles_of(&whole[..last], "spmtxt").unwrap_err();
    let sentence = error.to_string();
    assert!(
        sentence.contains("announces 40 splits and holds 39"),
        "{sentence}"
    );
    // The last split without its second face.
    let cut = whole.iter().rposition(|&byte| byte == b'&').unwrap();
    assert!(triangles_of(&whole[..cut], "spmtxt").is_err());
}

#[test]
fn a_split_of_too_large_a_fan_is_not_called_wrong() {
    let sentence = |ring: u32| {
        let mut text = format!("b {ring} {}\n$ {1} {1} 1\n", ring + 1, ring + 2);
        text += "v 1 0 0 0\n";
        for k in 0..ring {
            let angle = std::f64::consts::TAU * f64::from(k) / f64::from(ring);
            text += &format!("v {} {} {} 0\n", k + 2, angle.cos(), angle.sin());
        }
        for k in 0..ring {
            text += &format!("f {} 1 {} {} 0\n", k + 1, k + 2, (k + 1) % ring + 2);
        }
        // The middle, along the edges to the second vertex of the ring and to the one opposite.
        let half = ring / 2 + 1;
        text += &format!(
            "v* 1 1 {} {} 0 0 0.1 0 0 -0.1 0 0 0 0 0 0 0 & {} 0 2 0 0 -1 0 0 & -{} 0 {half} 0 0 -{} 0 0\n",
            ring + 2,
            ring + 3,
            ring + 1,
            ring + 2,
            half + 1
        );
        let read = triangles_of(text.as_bytes(), "spmtxt");
        read.map_err(|error| error.to_string())
            .map(|mesh| mesh.triangles.len())
    };
    assert_eq!(sentence(100), Ok(102));
    let refused = sentence(1100).unwrap_err();
    assert!(refused.contains("more than the 512 faces"), "{refused}");
}

#[test]
fn a_cdpm_that_is_cut_off_is_no_coarser_mesh() {
    let whole = include_bytes!("../../../tests/corpus/torus.cdpm");
    assert_eq!(triangles_of(whole, "cdpm").unwrap().triangles.len(), 120);
    let text = std::str::from_utf8(whole).unwrap().trim_end();
    for length in 0..text.len() {
        let cut = read_mesh_bytes(&whole[..length], MeshFormat::Thesis);
        assert!(cut.is_err(), "cut behind {length} bytes");
    }
    let last = text.rfind('\n').unwrap();
    let sentence = triangles_of(&whole[..last], "cdpm")
        .unwrap_err()
        .to_string();
    assert!(
        sentence.contains("announces 48 splits and holds 47"),
        "{sentence}"
    );
    // Without the counts, what is left of the last split still tells.
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    let lines: Vec<&str> = lines.collect();
    let text = lines.join("\n");
    let read = |text: &str| read_mesh_bytes(text.as_bytes(), MeshFormat::Thesis);
    assert_eq!(read(&text).unwrap().triangles.len(), 120);
    let cut = &text[..text.rfind(' ').unwrap()];
    assert!(read(cut).is_err(), "{cut}");
    // Nor may a face be listed twice instead.
    let groups = cut.rfind('&').unwrap();
    let face = cut[groups..].split(' ').nth(2).unwrap();
    assert!(read(&format!("{cut} {face}")).is_err());
}

/// The figures of appendix A, with the base faces that its first split needs.
#[test]
fn a_cdpm_refines_as_printed_in_the_thesis() {
    let text = "# 3D model: 12 faces 9 vertices 1 VSPs\n# Base Mesh: 10 faces 8 vertices\n\
        v 0.0250617 0.0799181 -0.159895\nv 0.38019 0.230182 -0.0215354\n\
        v 0.108728 -0.155195 0.0126244\n\
        v -0.433037 0.231398 0.0454415\nv -0.357951 -0.143089 -0.116849\n\
        v 0.257309 0.187015 0.0507284\n\
        v -0.347619 -0.129812 0.124568\nv 0.151632 -0.043319 -0.08824\n\
        f 3 2 6\nf 5 4 1\nf 7 5 3\nf 2 1 6\nf 2 3 1\nf 1 3 5\nf 6 1 4\nf 3 6 7\nf 7 6 4\nf 4 5 7\n\
        v* 1 -0.123045 -0.00540496 -0.0360497 0.349609 -0.103558 -0.0485731 6 -5 & 3 5 4 6 2 7\n";
    let mesh = triangles_of(text.as_bytes(), "cdpm").unwrap();
    assert_eq!((mesh.positions.len(), mesh.triangles.len()), (9, 12));
    assert_eq!(mesh.positions[8][0], 0.025_061_7 + 0.349_609);
    // Closed: every edge is there once in each direction.
    let mut edges: Vec<(u32, u32)> = mesh
        .triangles
        .iter()
        .flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)])
        .collect();
    edges.sort_unstable();
    assert!(edges.windows(2).all(|pair| pair[0] != pair[1]));
    assert!(
        edges
            .iter()
            .all(|&(a, b)| edges.binary_search(&(b, a)).is_ok())
    );
    for bad in [
        "v* 1 0 0 0 0 0 0 6 -5 & 3 1",
        "v* 12 0 0 0 0 0 0 & 0",
        "f 1 2",
        "x 1",
    ] {
        let error = triangles_of(format!("{text}{bad}\n").as_bytes(), "cdpm").unwrap_err();
        assert!(error.to_string().starts_with("line 22:"), "{error}");
    }
}
