/// Upper bound of the function values that [`increasing_root`] computes.
const MAX_STEPS: usize = 200;
/// Relative width of the bracket, or Newton step, at which the root is good enough.
const TOLERANCE: f64 = 1e-14;

/// The root in `[0, end]` of an increasing function given with its slope, by Newton's method inside a bracket.
///
/// 0 where the function is not negative at 0 (or not a number there), `end` where it stays negative.
pub(crate) fn increasing_root(f: impl Fn(f64) -> (f64, f64), end: f64) -> f64 {
    let (value, slope) = f(0.0);
    if value.is_nan() || value >= 0.0 {
        return 0.0;
    }
    let (mut low, mut high) = (0.0, end);
    let mut x = newton(0.0, value, slope);
    for _ in 0..MAX_STEPS {
        if !(x > low && x < high) {
            x = middle(low, high);
        }
        let (value, slope) = f(x);
        if value < 0.0 {
            low = x;
        } else {
            high = x;
        }
        let next = newton(x, value, slope);
        let near = (next - x).abs() <= TOLERANCE * x && next > low && next < high;
        if value == 0.0 || near || high - low <= TOLERANCE * high {
            return x;
        }
        x = next;
    }
    x
}

fn newton(x: f64, value: f64, slope: f64) -> f64 {
    x - value / slope
}

/// Geometric where the bracket spans orders of magnitude, so that tiny roots are reached.
fn middle(low: f64, high: f64) -> f64 {
    if low > 0.0 && high / low > 4.0 {
        low.sqrt() * high.sqrt()
    } else if low <= 0.0 {
        high * 1e-3
    } else {
        0.5 * (low + high)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_roots_over_many_orders_of_magnitude() {
        for root in [1e-30, 1e-9, 0.3, 7.0, 1e20] {
            let cube = |x: f64| ((x / root).powi(3) - 1.0, 3.0 * x * x / root.powi(3));
            let end = root * 1e12;
            approx::assert_relative_eq!(increasing_root(cube, end), root, max_relative = 1e-12);
        }
        assert_eq!(increasing_root(|x| (x, 1.0), 5.0), 0.0);
        assert_eq!(increasing_root(|_| (f64::NAN, 1.0), 5.0), 0.0);
    }
}
