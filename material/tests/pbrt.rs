//! pbrt's scene, as a parser of pbrt-v4's files that is not ours takes it apart (crate `pbrt4`).

mod common;

use common::{medium, sample};
use material::{Face, Material, Overwrite, ScatteringMedium, SceneUnit, pbrt};
use pbrt4::param::{ParamList, ParamType};
use pbrt4::{Element, Error, Parser};

fn written(medium: &ScatteringMedium<'_>) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.pbrt");
    pbrt::write(&path, medium, Overwrite::Refuse).unwrap();
    std::fs::read_to_string(path).unwrap()
}

/// Every directive of the scene; nothing of it is left over.
fn directives(scene: &str) -> Vec<Element<'_>> {
    let mut parser = Parser::new(scene);
    let mut all = Vec::new();
    loop {
        match parser.parse_next() {
            Ok(element) => all.push(element),
            Err(Error::EndOfFile) => return all,
            Err(error) => panic!("after {all:?}: {error}"),
        }
    }
}

fn floats(list: &ParamList<'_>, name: &str) -> Vec<f32> {
    list.floats(name).unwrap().unwrap()
}

fn lit_from(material: &Material, face: Face) -> Material {
    let channels = material.channels().to_vec();
    let provenance = material.provenance().clone();
    Material::new(*material.grid(), channels, *material.optics(), face, provenance).unwrap()
}

/// Corners and normal of each triangle of a mesh.
fn triangles(mesh: &ParamList<'_>) -> Vec<([[f64; 3]; 3], [f64; 3])> {
    let points = floats(mesh, "P");
    let points = points.as_chunks::<3>().0.iter().map(|p| p.map(f64::from));
    let points: Vec<[f64; 3]> = points.collect();
    let corners = |corner: &[i32; 3]| corner.map(|i| points[usize::try_from(i).unwrap()]);
    let indices = mesh.integers("indices").unwrap().unwrap();
    assert_eq!(indices.len() % 3, 0);
    let with_normal = |[a, b, c]: [[f64; 3]; 3]| {
        let (u, v): ([f64; 3], [f64; 3]) =
            (std::array::from_fn(|i| b[i] - a[i]), std::array::from_fn(|i| c[i] - a[i]));
        let normal = std::array::from_fn(|i| {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            u[j] * v[k] - u[k] * v[j]
        });
        ([a, b, c], normal)
    };
    indices.as_chunks().0.iter().map(corners).map(with_normal).collect()
}

#[test]
fn the_medium_has_every_voxel_and_one_around() {
    for names in [&["R", "G", "B"][..], &["Y"]] {
        let material = sample(names);
        let medium = medium(&material, SceneUnit::Centimetre);
        let scene = written(&medium);
        let all = directives(&scene);
        let grid = all.iter().find_map(|element| match element {
            Element::MakeNamedMedium { name: "material", params } => Some(params),
            _ => None,
        });
        let grid = grid.unwrap();
        assert_eq!(grid.string("type"), Some("\"rgbgrid\""));
        let cells = ["nx", "ny", "nz"].map(|name| grid.integer(name, 0).unwrap());
        assert_eq!(cells, [5 + 2, 4 + 2, 3 + 2]);
        assert_eq!((grid.float("g", 9.0).unwrap(), grid.float("scale", 9.0).unwrap()), (0.0, 1.0));
        // 0.01 × 0.025 × 1/30 cm a cell.
        assert_eq!(floats(grid, "p0"), [-0.01, -0.025, -1.0 / 30.0]);
        assert_eq!(floats(grid, "p1"), [0.06, 0.125, 4.0 / 30.0]);
        let [sigma_a, sigma_s] = ["sigma_a", "sigma_s"].map(|name| {
            assert_eq!(grid.get(name).unwrap().ty, ParamType::Rgb);
            floats(grid, name)
        });
        assert_eq!((sigma_a.len(), sigma_s.len()), (3 * 7 * 6 * 5, 3 * 7 * 6 * 5));
        for (voxel, (a, s)) in sigma_a.chunks(3).zip(sigma_s.chunks(3)).enumerate() {
            // x is the fastest; the block's outer voxels stand around it once more.
            let at = [voxel % 7, voxel / 7 % 6, voxel / 42];
            let last = [4, 3, 2];
            let inside = std::array::from_fn(|i| at[i].saturating_sub(1).min(last[i]));
            for c in 0..3 {
                let expected = medium.sigma(c.min(names.len() - 1), medium.index(inside));
                assert_eq!((a[c], s[c]), (expected.0 as f32, expected.1 as f32), "{at:?}");
            }
        }
    }
}

/// The block is closed and its faces look outwards, which is how pbrt tells in from out; the light
/// shines at it, reflects nothing, and does not stand in the camera's way.
#[test]
fn the_scene_is_the_block_lit_on_its_lit_face() {
    for face in [Face::Back, Face::Front] {
        let material = lit_from(&sample(&["R", "G", "B"]), face);
        let medium = medium(&material, SceneUnit::Millimetre);
        let scene = written(&medium);
        let all = directives(&scene);
        let begin = all.iter().position(|e| matches!(e, Element::WorldBegin)).unwrap();
        let eye = all.iter().find_map(|element| match element {
            Element::LookAt { eye, .. } => Some(f64::from(eye[2])),
            _ => None,
        });
        let eye = eye.unwrap();
        for (is_there, name) in [
            (
                all[..begin]
                    .iter()
                    .any(|e| matches!(e, Element::Camera { ty: "orthographic", .. })),
                "camera",
            ),
            (
                all[..begin].iter().any(|e| matches!(e, Element::Integrator { ty: "volpath", .. })),
                "integrator",
            ),
            (
                all[begin..].iter().any(|e| {
                    matches!(e, Element::MediumInterface { interior: "material", exterior: "" })
                }),
                "medium",
            ),
        ] {
            assert!(is_there, "{name}");
        }
        let mut meshes = all.iter().filter_map(|element| match element {
            Element::Shape { name: "trianglemesh", params } => Some(triangles(params)),
            _ => None,
        });
        let (light, block) = (meshes.next().unwrap(), meshes.next().unwrap());
        assert!(meshes.next().is_none());
        // The light's attributes come first.
        let black = all.iter().find_map(|element| match element {
            Element::Material { ty: "diffuse", params } => Some(floats(params, "reflectance")),
            _ => None,
        });
        assert_eq!(black, Some(vec![0.0; 3]));

        let [x, y, z] = medium.size();
        let centre = [0.5 * x, 0.5 * y, 0.5 * z];
        let mut volume = 0.0;
        for (corners, normal) in &block {
            let outwards: f64 = (0..3).map(|i| (corners[0][i] - centre[i]) * normal[i]).sum();
            assert!(outwards > 0.0, "{corners:?}");
            volume += outwards / 6.0;
        }
        // The sum over a closed surface is its volume; corners are f32.
        assert!((volume / (x * y * z) - 1.0).abs() < 1e-6, "{volume}");
        for (corners, normal) in &light {
            let towards: f64 = (0..3).map(|i| (centre[i] - corners[0][i]) * normal[i]).sum();
            assert!(towards > 0.0, "{face:?}");
            let outside = if face == Face::Back { -corners[0][2] } else { corners[0][2] - z };
            assert!(outside > 0.0 && outside < 0.01, "{outside}");
            let seen_first = corners[0][2] < eye && corners[0][2] > z;
            assert!(eye > z && !seen_first, "{face:?}: the camera at {eye} sees the light's back");
        }
    }
}
