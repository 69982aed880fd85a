//! How steep a depth map is, and where.
//!
//! Steepness is no quality: noise and unsharp masking raise it. It is informative only beside its split into pixels near
//! the true edges, where it should rise, and pixels away from them, where it should not.

use super::edges::Edges;
use crate::raster::{Map, Mask, erode, gather, same_shape, sobel};
use crate::{Error, Result};
use mde_uncertainty::statistics::median;
use ndarray::{Array2, Zip};

/// Mean gradient of the map over its median depth, per pixel:
///
/// \\[ S(D) = \frac{1}{|m'|} \sum_{x \in m'} \frac{|\nabla D(x)|}{8 \operatorname{median}_m D} \\]
///
/// with the Sobel gradient (gain 8) and \\(m'\\) the mask eroded by a pixel. Blind to scale. The
/// paper reports the ratio \\(S(\text{refined}) / S(\text{prior})\\).
///
/// # Errors
/// [`Error::Shape`] where map and mask differ, [`Error::Empty`] without a pixel, [`Error::Value`] for a median that is not positive.
pub fn sharpness(map: Map<'_>, mask: Mask<'_>) -> Result<f64> {
    let everywhere = Array2::from_elem(mask.dim(), true);
    let [on, _] = split(map, mask, &everywhere)?;
    on.ok_or(Error::Empty("the sharpness"))
}

/// [`sharpness`] on the true edges, within `band` pixels (Euclidean) of them, and off them, beyond; nothing where no pixel is there.
///
/// `edges` are the truth's ([`edges::edges`](super::edges::edges)).
///
/// # Errors
/// As [`sharpness`].
pub fn sharpness_by_edges(
    map: Map<'_>,
    mask: Mask<'_>,
    edges: &Edges,
    band: f64,
) -> Result<[Option<f64>; 2]> {
    same_shape("the edge map", edges.pixels.dim(), mask.dim())?;
    split(map, mask, &edges.distance.mapv(|d| d <= band))
}

fn split(map: Map<'_>, mask: Mask<'_>, near: &Array2<bool>) -> Result<[Option<f64>; 2]> {
    same_shape("the prediction", map.dim(), mask.dim())?;
    let middle = median(gather(map, mask)).ok_or(Error::Empty("the sharpness"))?;
    if !(middle > 0.0 && middle.is_finite()) {
        let (what, expected) = ("the median depth", "positive and finite");
        return Err(Error::Value { what, index: 0, value: middle, expected });
    }
    let everywhere = erode(mask);
    let mut sums = [(0.0, 0_usize); 2];
    let gradient = sobel(map);
    Zip::from(&gradient).and(&everywhere).and(near).for_each(|&slope, &keep, &near| {
        if keep {
            let (sum, count) = &mut sums[usize::from(!near)];
            *sum += f64::from(slope);
            *count += 1;
        }
    });
    Ok(sums.map(|(sum, count)| (count > 0).then(|| sum / count as f64 / (8.0 * middle))))
}
