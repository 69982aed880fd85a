//! Which depths other photographs confirm.

use mde_uncertainty::GaussianDepth;
use mde_warp::PosedView;
use ndarray::{Array2, ArrayView2};
use rayon::prelude::*;
use std::borrow::Borrow;

use crate::{Error, Result};
use mde_warp::transfer::{Seen, Transfer};

/// Distance in pixels, there and back, within which two photographs agree.
const PIXELS: f64 = 1.0;
/// Factor between depths within which they agree, .1 in log depth.
const LOG_DEPTH: f64 = 1.105_170_918_075_647_6;

/// Number of other views that agree with each pixel's depth, and of those that could; at most 255.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Agreement {
    /// Views whose depth, carried back, lands on the pixel.
    pub agree: Array2<u8>,
    /// Views on whose image the point lands, where their depth is known.
    pub visible: Array2<u8>,
}

/// Compares the depth of `views[reference]` with those of `others`: there and back within 1 pixel and .1 in log depth.
///
/// # Errors
/// [`Error::Reference`] for an index outside the views, [`Error::View`] for a map of another size.
pub fn agreement<V: Borrow<PosedView>>(
    views: &[V],
    depths: &[&GaussianDepth],
    reference: usize,
    others: &[usize],
) -> Result<Agreement> {
    let missing = |i: usize| Error::Reference { reference: i, views: views.len().min(depths.len()) };
    let of = |i: usize| -> Result<(&PosedView, &GaussianDepth)> {
        Ok((views.get(i).ok_or(missing(i))?.borrow(), *depths.get(i).ok_or(missing(i))?))
    };
    let (from, depth) = of(reference)?;
    from.camera.check_map("depth", depth.dim())?;
    let mut agree: Array2<u8> = Array2::zeros(depth.dim());
    let mut visible: Array2<u8> = Array2::zeros(depth.dim());
    for &other in others.iter().filter(|&&i| i != reference) {
        let (to, there) = of(other)?;
        to.camera.check_map("depth", there.dim())?;
        let (forth, back) = (Transfer::new(from, to), Transfer::new(to, from));
        let maps = [depth.mean(), there.mean()];
        let mut rows: Vec<_> = agree.outer_iter_mut().zip(visible.outer_iter_mut()).enumerate().collect();
        rows.par_iter_mut().for_each(|(y, (agree, visible))| {
            for x in 0..agree.len() {
                let Some((z, seen, z_there)) = landed(&forth, maps, [x, *y]) else { continue };
                visible[x] = visible[x].saturating_add(1);
                let ratio = f64::from(z_there) / (f64::from(z) * seen.ratio);
                if !(LOG_DEPTH.recip()..=LOG_DEPTH).contains(&ratio) {
                    continue;
                }
                let Some(there) = back.at(seen.x, seen.y, 1.0 / f64::from(z_there)) else { continue };
                let [right, down] = [there.x - x as f64, there.y - *y as f64];
                if right * right + down * down <= PIXELS * PIXELS {
                    agree[x] = agree[x].saturating_add(1);
                }
            }
        });
    }
    Ok(Agreement { agree, visible })
}

/// The depth of a pixel, where it lands in another view, and the depth there.
fn landed(
    forth: &Transfer,
    [depth, there]: [ArrayView2<'_, f32>; 2],
    [x, y]: [usize; 2],
) -> Option<(f32, Seen, f32)> {
    let z = Some(depth[(y, x)]).filter(|z| *z > 0.0)?;
    let seen = forth.at(x as f64, y as f64, 1.0 / f64::from(z))?;
    let z_there = Some(there[forth.nearest(&seen)?]).filter(|z| *z > 0.0)?;
    Some((z, seen, z_there))
}

/// Whether any of the others has the depth of a pixel of the first view; the maps, 0 where unknown, have the size of their views.
pub(super) fn shown(views: &[PosedView], depths: &[ArrayView2<'_, f32>]) -> Array2<bool> {
    let others = views.iter().zip(depths).skip(1);
    let others: Vec<_> = others.map(|(to, there)| (Transfer::new(&views[0], to), *there)).collect();
    let by =
        |(y, x)| others.iter().any(|(forth, there)| landed(forth, [depths[0], *there], [x, y]).is_some());
    Array2::from_shape_fn(depths[0].dim(), by)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::room;

    fn exact(depth: &Array2<f32>) -> GaussianDepth {
        GaussianDepth::new(depth.clone(), depth.mapv(|_| 1e-4)).unwrap()
    }

    #[test]
    fn agreement_is_counted_there_and_back() {
        let (views, depths, _) = room(1.0);
        let mut maps: Vec<GaussianDepth> = depths.iter().map(exact).collect();
        let count = |maps: &[GaussianDepth]| {
            let maps: Vec<&GaussianDepth> = maps.iter().collect();
            agreement(&views, &maps, 0, &[0, 1, 2, 3]).unwrap()
        };
        let before = count(&maps);
        let middle = (36, 48);
        assert_eq!((before.agree[middle], before.visible[middle]), (3, 3));
        for wrong in [0.7, 1.4] {
            maps[0] = exact(&depths[0].mapv(|z| wrong * z));
            assert_eq!(count(&maps).agree[middle], 0);
        }
    }

    #[test]
    fn hundreds_of_views_are_counted_to_255() {
        let (views, depths, _) = room(1.0);
        let (views, exact) = (vec![views[0].clone(); 300], exact(&depths[0]));
        let others: Vec<usize> = (0..300).collect();
        let found = agreement(&views, &[&exact; 300], 0, &others).unwrap();
        assert_eq!((found.agree[(36, 48)], found.visible[(36, 48)]), (255, 255));
    }
}
