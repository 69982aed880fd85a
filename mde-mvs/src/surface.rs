//! One surface of many depth maps.

use crate::cloud::DepthView;
use crate::{Result, nearest_pixel};
use fast_surface_nets::ndshape::RuntimeShape;
use fast_surface_nets::{SurfaceNetsBuffer, surface_nets};
use mde_uncertainty::statistics::quantile;
use nalgebra::{Point2, Point3, Vector3};
use rayon::prelude::*;

/// Voxels at most.
const VOXELS: f64 = 4e6;
/// Distances are cut at this number of voxels.
const CUT: f32 = 4.0;
/// Photographs that have to show a voxel near the surface, of two and more.
const SHOWN: u8 = 2;
/// Share of the points beyond each side of the box, and the pixels between two of them along each axis.
const BEYOND: f64 = 0.005;
const STRIDE: usize = 4;

/// A vertex of a [`Surface`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vertex {
    /// In the world of the poses.
    pub position: [f32; 3],
    /// Unit normal, the mean of its triangles', towards the photographs.
    pub normal: [f32; 3],
    /// sRGB, 0 to 1.
    pub colour: [f32; 3],
    /// Standard deviation of its distance along the rays of the photographs.
    pub sigma: f32,
}

/// Triangles, counterclockwise as seen from the photographs.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Surface {
    /// Its vertices.
    pub vertices: Vec<Vertex>,
    /// Each by the indices of three vertices.
    pub triangles: Vec<[u32; 3]>,
}

/// The voxels of a box.
struct Grid {
    corner: Point3<f64>,
    /// Side of a voxel.
    edge: f64,
    size: [usize; 3],
}

/// What the photographs show at a voxel: sums of weights, weighted distances and weighted colours, and of photographs near the surface.
#[derive(Debug, Clone, Copy, Default)]
struct Voxel {
    weight: f32,
    distance: f32,
    colour: [f32; 3],
    near: f32,
    shown: u8,
}

/// The surface of the depths of photographs: truncated signed distances along their rays (Curless and Levoy, 1996), fused in each voxel by
/// precision, \\( d = \sum_v d_v / \sigma_v^2 / \sum_v 1 / \sigma_v^2 \\) (Eq. 7), where the square of half a voxel is added to
/// \\( \sigma_v^2 \\), and its zero by surface nets. Depths with a sigma above 6 % have no part; of several photographs two have to show a voxel.
///
/// The variance of a vertex is the harmonic mean of those of its photographs, which share matches and poses, so that their number proves
/// nothing. The box of the depths has at most 4 million voxels.
///
/// # Errors
/// [`Error::View`](crate::Error::View) for a map of another size than its camera.
pub fn surface(views: &[DepthView<'_>]) -> Result<Surface> {
    for view in views {
        for map in [view.depth.dim(), view.sigma.dim(), (view.image.dim().0, view.image.dim().1)] {
            view.camera.check_map("map", map)?;
        }
    }
    let Some(grid) = Grid::about(views) else { return Ok(Surface::default()) };
    let voxels = grid.fused(views);
    let least = SHOWN.min(views.len() as u8);
    // Where no photograph shows anything there is no surface either: NaN is on neither side of it.
    let distance = |v: &Voxel| if v.shown >= least { v.distance / v.weight } else { f32::NAN };
    let distances: Vec<f32> = voxels.iter().map(distance).collect();
    let size = grid.size.map(|side| side as u32);
    let shape = RuntimeShape::<u32, 3>::new(size);
    let mut nets = SurfaceNetsBuffer::default();
    surface_nets(&distances, &shape, [0; 3], size.map(|side| side - 1), &mut nets);
    Ok(grid.surface(&voxels, &nets))
}

impl Grid {
    /// The box of the sure depths, but for the outermost.
    fn about(views: &[DepthView<'_>]) -> Option<Self> {
        let mut along: [Vec<f64>; 3] = Default::default();
        let mut footprints = Vec::new();
        for view in views {
            let world = view.pose.inverse();
            let (height, width) = view.camera.dim();
            for row in (0..height).step_by(STRIDE) {
                for column in (0..width).step_by(STRIDE) {
                    let Some([z, _]) = view.sure((row, column)) else { continue };
                    let pixel = Point2::new(column as f64, row as f64);
                    let point = world * view.camera.unproject(pixel, f64::from(z));
                    along.iter_mut().zip(point.iter()).for_each(|(along, x)| along.push(*x));
                    footprints.push(f64::from(z) / view.camera.fx);
                }
            }
        }
        let footprint = quantile(&mut footprints, 0.5)?;
        let mut ends = [[0.0; 2]; 3];
        for (ends, along) in ends.iter_mut().zip(&mut along) {
            *ends = [quantile(along, BEYOND)?, quantile(along, 1.0 - BEYOND)?];
        }
        let volume: f64 = ends.iter().map(|[low, high]| (high - low).max(footprint)).product();
        // A pixel's footprint is the finest that the depths can show.
        let edge = (volume / VOXELS).cbrt().max(footprint);
        let margin = f64::from(CUT) * edge;
        let side = |[low, high]: [f64; 2]| ((high - low + 2.0 * margin) / edge).ceil() as usize + 1;
        Some(Self { corner: Point3::from(ends.map(|[low, _]| low - margin)), edge, size: ends.map(side) })
    }

    fn centre(&self, cell: [f64; 3]) -> Point3<f64> {
        self.corner + Vector3::from(cell) * self.edge
    }

    fn fused(&self, views: &[DepthView<'_>]) -> Vec<Voxel> {
        let [wide, tall, deep] = self.size;
        let mut voxels = vec![Voxel::default(); wide * tall * deep];
        let cut = CUT * self.edge as f32;
        voxels.par_chunks_mut(wide * tall).enumerate().for_each(|(z, layer)| {
            for view in views {
                for (at, voxel) in layer.iter_mut().enumerate() {
                    let cell = [at % wide, at / wide, z].map(|index| index as f64);
                    let point = view.pose * self.centre(cell);
                    let Some(at) = nearest_pixel(&view.camera, &point) else { continue };
                    let Some([depth, sigma]) = view.sure(at) else { continue };
                    let distance = depth - point.z as f32;
                    if distance < -cut {
                        continue;
                    }
                    let weight = 1.0 / (sigma * sigma + 0.25 * (self.edge * self.edge) as f32);
                    voxel.weight += weight;
                    voxel.distance += weight * distance.min(cut);
                    if distance < cut {
                        voxel.near += weight;
                        voxel.shown = voxel.shown.saturating_add(1);
                        for (channel, sum) in voxel.colour.iter_mut().enumerate() {
                            *sum += weight * view.image[(at.0, at.1, channel)];
                        }
                    }
                }
            }
        });
        voxels
    }

    /// The triangles of the nets whose corners are known, with the colours of the nearest voxel.
    fn surface(&self, voxels: &[Voxel], nets: &SurfaceNetsBuffer) -> Surface {
        let [wide, tall, _] = self.size;
        let mut surface = Surface::default();
        let mut places = vec![None; nets.positions.len()];
        for triangle in nets.indices.chunks_exact(3) {
            let finite = |&corner: &u32| nets.positions[corner as usize].iter().all(|x| x.is_finite());
            if !triangle.iter().all(finite) {
                continue;
            }
            let corner = |&corner: &u32| {
                *places[corner as usize].get_or_insert_with(|| {
                    let at = nets.positions[corner as usize];
                    let [x, y, z] = at.map(|x| x.round() as usize);
                    let voxel = voxels[x + wide * (y + tall * z)];
                    surface.vertices.push(Vertex {
                        position: self.centre(at.map(f64::from)).coords.map(|x| x as f32).into(),
                        normal: [0.0; 3],
                        colour: voxel.colour.map(|sum| sum / voxel.near),
                        sigma: (f32::from(voxel.shown) / voxel.near).sqrt(),
                    });
                    surface.vertices.len() as u32 - 1
                })
            };
            let [a, b, c] = [0, 1, 2].map(|i| &triangle[i]).map(corner);
            surface.triangles.push([a, b, c]);
        }
        // The gradient of the distances is not known at the rim.
        let mut normals = vec![Vector3::<f32>::zeros(); surface.vertices.len()];
        for corners in surface.triangles.iter().map(|triangle| triangle.map(|corner| corner as usize)) {
            let [a, b, c] = corners.map(|corner| Vector3::from(surface.vertices[corner].position));
            let across = (b - a).cross(&(c - a));
            corners.iter().for_each(|&corner| normals[corner] += across);
        }
        for (vertex, normal) in surface.vertices.iter_mut().zip(normals) {
            vertex.normal = normal.try_normalize(0.0).unwrap_or_default().into();
        }
        surface
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{Plane, scene};
    use ndarray::Array2;

    const CENTRES: [[f64; 3]; 3] = [[0.0; 3], [0.3, 0.0, 0.0], [0.0, 0.2, 0.0]];

    fn of(views: &[mde_warp::PosedView], depths: &[Array2<f32>], sigmas: &[Array2<f32>]) -> Surface {
        let maps = views.iter().zip(depths.iter().zip(sigmas));
        let views: Vec<DepthView<'_>> = maps
            .map(|(view, (depth, sigma))| DepthView {
                image: view.image.view(),
                camera: view.camera,
                pose: view.pose,
                depth: depth.view(),
                sigma: sigma.view(),
            })
            .collect();
        surface(&views).unwrap()
    }

    /// A slanted wall: vertices on it, normals and triangles towards the cameras.
    #[test]
    fn the_surface_of_a_wall_is_the_wall() {
        let (views, depths) = scene(&[Plane::slanted(2.0, 0.3, 0.1)], (60, 80), &CENTRES);
        let sigmas: Vec<_> = depths.iter().map(|depth| depth.mapv(|z| 0.01 * z)).collect();
        let found = of(&views, &depths, &sigmas);
        assert!(found.triangles.len() > 2000, "{}", found.triangles.len());
        let normal = Vector3::new(0.3_f32, 0.1, -1.0).normalize();
        for vertex in &found.vertices {
            let [x, y, z] = vertex.position;
            assert!((z - 2.0 - 0.3 * x - 0.1 * y).abs() < 0.02, "{x} {y} {z}");
            assert!(Vector3::from(vertex.normal).dot(&normal) > 0.9, "{:?}", vertex.normal);
            assert!((0.01..0.05).contains(&vertex.sigma), "{}", vertex.sigma);
        }
        for triangle in &found.triangles {
            let [a, b, c] = triangle.map(|i| Vector3::from(found.vertices[i as usize].position));
            let area = (b - a).cross(&(c - a));
            assert!(area.norm() == 0.0 || area.dot(&normal) > 0.0);
        }
    }

    /// Eq. 7: two photographs of a wall at another depth each; the surface lies where their precisions put it.
    #[test]
    fn photographs_count_by_their_precision() {
        let (views, depths) = scene(&[Plane::slanted(2.0, 0.0, 0.0)], (60, 80), &CENTRES[..2]);
        let depths = [depths[0].clone(), depths[1].mapv(|z| z + 0.04)];
        let sigmas = [depths[0].mapv(|_| 0.1), depths[1].mapv(|_| 0.05)];
        let found = of(&views, &depths, &sigmas);
        let mean = found.vertices.iter().map(|v| f64::from(v.position[2])).sum::<f64>()
            / found.vertices.len() as f64;
        // Half a voxel of a pixel's footprint is added to both variances.
        let edge = 2.0 / views[0].camera.fx;
        let [a, b] = [0.1_f64, 0.05].map(|s| 1.0 / (s * s + 0.25 * edge * edge));
        assert!((mean - 2.0 - 0.04 * b / (a + b)).abs() < 0.003, "{mean}");
    }

    #[test]
    fn what_is_unsure_or_shown_once_is_no_surface() {
        let (views, depths) = scene(&[Plane::slanted(2.0, 0.0, 0.0)], (30, 40), &CENTRES[..2]);
        let unsure: Vec<_> = depths.iter().map(|depth| depth.mapv(|z| 0.1 * z)).collect();
        assert_eq!(of(&views, &depths, &unsure), Surface::default());
        let sure = depths[0].mapv(|z| 0.01 * z);
        let missing = depths[0].mapv(|_| f32::INFINITY);
        assert_eq!(of(&views, &depths, &[sure.clone(), missing]), Surface::default());
        assert!(!of(&views[..1], &depths[..1], &[sure]).triangles.is_empty());
        assert_eq!(surface(&[]).unwrap(), Surface::default());
    }
}
