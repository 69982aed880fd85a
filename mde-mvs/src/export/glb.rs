//! Binary glTF, y up: a depth map as a mesh with the photograph as its texture, torn at depth edges, and the surface of a capture.

use crate::cloud::DepthView;
use crate::surface::{Surface, Vertex};
use serde_json::{Value, json};

/// About so many vertices: a larger map is thinned, the texture is not.
const VERTICES: usize = 1_000_000;
/// Triangles are torn where the disparities of their corners differ by more than this share, as the warp's.
const TEAR: f64 = 0.05;
const MAGIC: &[u8; 4] = b"glTF";
const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// The mesh of a depth map in the frame of its camera, at most about a million vertices, with the photograph as its texture: `png` is the
/// file of [`DepthView::image`].
pub fn encode(view: &DepthView<'_>, png: Vec<u8>, unit: &str) -> Vec<u8> {
    let (vertices, triangles) = mesh(view, TEAR);
    let attributes = [("POSITION", "VEC3", 0), ("TEXCOORD_0", "VEC2", 3), ("_SIGMA", "SCALAR", 5)];
    file(unit, &vertices, &triangles, &attributes, Some(png))
}

/// The surface of a capture, with the colours of its vertices.
pub fn encode_surface(surface: &Surface, unit: &str) -> Vec<u8> {
    // glTF's colours of vertices are linear.
    let linear = |c: f32| if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) };
    let numbers = |vertex: &Vertex| {
        let ([x, y, z], [u, v, w]) = (vertex.position, vertex.normal);
        let [red, green, blue] = vertex.colour.map(linear);
        [x, -y, -z, u, -v, -w, red, green, blue, vertex.sigma]
    };
    let vertices: Vec<[f32; 10]> = surface.vertices.iter().map(numbers).collect();
    let attributes =
        [("POSITION", "VEC3", 0), ("NORMAL", "VEC3", 3), ("COLOR_0", "VEC3", 6), ("_SIGMA", "SCALAR", 9)];
    file(unit, &vertices, &surface.triangles, &attributes, None)
}

/// A mesh with these attributes, each by its type and its place among the numbers of a vertex, that of the position first, and the picture
/// that is its texture.
fn file<const NUMBERS: usize>(
    unit: &str,
    vertices: &[[f32; NUMBERS]],
    triangles: &[[u32; 3]],
    attributes: &[(&str, &str, usize)],
    picture: Option<Vec<u8>>,
) -> Vec<u8> {
    let asset = json!({ "version": "2.0", "generator": "mde", "extras": { "unit": unit } });
    if triangles.is_empty() {
        // An accessor holds at least one element: without a surface there is no mesh.
        return container(&json!({ "asset": asset, "scene": 0, "scenes": [{}] }), &[]);
    }
    let mut data: Vec<u8> = vertices.iter().flatten().flat_map(|number| number.to_le_bytes()).collect();
    let indices = data.len();
    data.extend(triangles.iter().flatten().flat_map(|index| index.to_le_bytes()));
    let image = data.len();
    let mut views = vec![
        json!({ "buffer": 0, "byteOffset": 0, "byteLength": indices, "byteStride": 4 * NUMBERS, "target": ARRAY_BUFFER }),
        json!({ "buffer": 0, "byteOffset": indices, "byteLength": image - indices, "target": ELEMENT_ARRAY_BUFFER }),
    ];
    let range = |wanted: fn(f32, f32) -> f32, start: f32| {
        [0, 1, 2].map(|axis| vertices.iter().map(|vertex| vertex[axis]).fold(start, wanted))
    };
    let accessor = |(_, kind, place): &(&str, &str, usize)| json!({ "bufferView": 0, "byteOffset": 4 * place, "componentType": FLOAT, "count": vertices.len(), "type": kind });
    let mut accessors: Vec<Value> = attributes.iter().map(accessor).collect();
    accessors[0]["min"] = json!(range(f32::min, f32::INFINITY));
    accessors[0]["max"] = json!(range(f32::max, f32::NEG_INFINITY));
    accessors.push(
        json!({ "bufferView": 1, "componentType": UNSIGNED_INT, "count": 3 * triangles.len(), "type": "SCALAR" }),
    );
    let places: serde_json::Map<String, Value> =
        attributes.iter().enumerate().map(|(place, (name, ..))| ((*name).to_owned(), json!(place))).collect();
    let mut root = json!({
        "asset": asset,
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "name": "depth", "mesh": 0 }],
        "materials": [{
            "doubleSided": true,
            "pbrMetallicRoughness": { "metallicFactor": 0.0, "roughnessFactor": 1.0 },
            "extensions": { "KHR_materials_unlit": {} },
        }],
        "accessors": accessors,
        "meshes": [{ "name": "depth", "primitives": [{
            "attributes": places, "indices": attributes.len(), "material": 0,
        }] }],
    });
    if let Some(picture) = picture {
        views.push(json!({ "buffer": 0, "byteOffset": image, "byteLength": picture.len() }));
        data.extend(picture);
        data.resize(data.len().next_multiple_of(4), 0);
        root["images"] = json!([{ "bufferView": 2, "mimeType": "image/png" }]);
        root["samplers"] = json!([{ "magFilter": 9729, "minFilter": 9729, "wrapS": 33071, "wrapT": 33071 }]);
        root["textures"] = json!([{ "source": 0, "sampler": 0 }]);
        root["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = json!({ "index": 0 });
    }
    root["bufferViews"] = json!(views);
    root["buffers"] = json!([{ "byteLength": data.len() }]);
    container(&root, &data)
}

/// Header, JSON and data.
fn container(root: &Value, data: &[u8]) -> Vec<u8> {
    let mut text = root.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let parts: &[(&[u8; 4], &[u8])] = match data {
        [] => &[(b"JSON", &text)],
        _ => &[(b"JSON", &text), (b"BIN\0", data)],
    };
    let length: usize = 12 + parts.iter().map(|(_, part)| 8 + part.len()).sum::<usize>();
    let mut bytes = MAGIC.to_vec();
    bytes.extend(2_u32.to_le_bytes());
    bytes.extend((length as u32).to_le_bytes());
    for (kind, part) in parts {
        bytes.extend((part.len() as u32).to_le_bytes());
        bytes.extend(*kind);
        bytes.extend(*part);
    }
    bytes
}

/// Vertices (position, place in the texture, sigma) and triangles of a depth map, torn where the disparities of corners differ by more than
/// the share `tear` of the largest.
fn mesh(view: &DepthView<'_>, tear: f64) -> (Vec<[f32; 6]>, Vec<[u32; 3]>) {
    let (rows, columns) = view.depth.dim();
    let step = ((rows * columns) as f64 / VERTICES as f64).sqrt().ceil().max(1.0) as usize;
    let (tall, wide) = (rows.div_ceil(step), columns.div_ceil(step));
    // Pixel centres are at integers, the texture's at halves.
    let place = |index: usize, side: usize| (((index * step) as f64 + 0.5) / side as f64) as f32;
    let point = |v: usize, u: usize| view.point(v * step, u * step);
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    let mut index = vec![None; tall * wide];
    for v in 0..tall.saturating_sub(1) {
        for u in 0..wide.saturating_sub(1) {
            // Counterclockwise as seen from the camera, which is the front.
            for corners in [[(v, u), (v + 1, u), (v, u + 1)], [(v, u + 1), (v + 1, u), (v + 1, u + 1)]] {
                let points = corners.map(|(v, u)| point(v, u));
                let [Some(a), Some(b), Some(c)] = points else { continue };
                if 1.0 - a.z.min(b.z).min(c.z) / a.z.max(b.z).max(c.z) > tear * step as f64 {
                    continue;
                }
                let mut triangle = [0; 3];
                for ((corner, (v, u)), point) in triangle.iter_mut().zip(corners).zip([a, b, c]) {
                    *corner = *index[v * wide + u].get_or_insert_with(|| {
                        let sigma = view.sigma[(v * step, u * step)];
                        // x right, y up, z backward: the camera looks along -z.
                        let [x, y, z] = [point.x, -point.y, -point.z].map(|number| number as f32);
                        vertices.push([x, y, z, place(u, columns), place(v, rows), sigma]);
                        vertices.len() as u32 - 1
                    });
                }
                triangles.push(triangle);
            }
        }
    }
    (vertices, triangles)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::tests::{SIZE, triangle, with_plane};
    use nalgebra::Vector3;

    fn parts(bytes: &[u8]) -> (Value, &[u8]) {
        let number = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
        assert_eq!((&bytes[..4], number(4), number(8)), (&MAGIC[..], 2, bytes.len()));
        let json = number(12);
        let root = serde_json::from_slice(&bytes[20..20 + json]).unwrap();
        (root, bytes.get(28 + json..).unwrap_or_default())
    }

    #[test]
    fn a_plane_with_a_hole_is_one_surface_without_the_triangles_at_the_hole() {
        with_plane(|scene| {
            // The plane is so slanted that the usual limit tears a column of it.
            let (vertices, triangles) = mesh(scene, 2.0 * TEAR);
            // A corner inside of the map has six triangles.
            assert_eq!(vertices.len(), SIZE.0 * SIZE.1 - 1);
            assert_eq!(triangles.len(), 2 * (SIZE.0 - 1) * (SIZE.1 - 1) - 6);
            for [x, _, z, _, _, sigma] in &vertices {
                assert!((-z - 2.0 - 0.5 * x).abs() < 1e-5, "{x} {z}");
                assert!((sigma + 0.1 * z).abs() < 1e-5, "{sigma} {z}");
            }
            for triangle in &triangles {
                let [a, b, c] = triangle.map(|i| Vector3::from_row_slice(&vertices[i as usize][..3]));
                // The front faces the camera at the origin.
                assert!((b - a).cross(&(c - a)).dot(&a) < 0.0, "{a} {b} {c}");
            }
            let (fewer, torn) = mesh(scene, TEAR);
            assert!(torn.len() < triangles.len());
            let bytes = encode(scene, b"PNG".to_vec(), "m");
            let (root, data) = parts(&bytes);
            let count = |accessor: usize| root["accessors"][accessor]["count"].as_u64().unwrap() as usize;
            assert_eq!([0, 1, 2, 3].map(count), [fewer.len(), fewer.len(), fewer.len(), 3 * torn.len()]);
            let numbers = fewer.iter().flatten().flat_map(|number| number.to_le_bytes());
            let indices = torn.iter().flatten().flat_map(|index| index.to_le_bytes());
            assert!(data.iter().copied().eq(numbers.chain(indices).chain(*b"PNG\0")));
        });
    }

    #[test]
    fn a_surface_stands_upright_with_linear_colours() {
        let bytes = encode_surface(&triangle(), "m");
        let (root, data) = parts(&bytes);
        let float = |at: usize| f32::from_le_bytes(data[at..at + 4].try_into().unwrap());
        let second: Vec<f32> = (0..10).map(|i| float(40 + 4 * i)).collect();
        assert_eq!(second[..7], [1.0, -1.0, -2.0, 0.0, 0.0, 1.0, 1.0]);
        assert!((second[7] - 0.214).abs() < 1e-3 && second[8..] == [0.0, 0.1]);
        assert_eq!(root["accessors"][0]["max"], json!([2.0, -1.0, -2.0]));
        assert_eq!((root["accessors"][4]["count"].as_u64(), data.len()), (Some(3), 3 * 40 + 12));
    }
}
