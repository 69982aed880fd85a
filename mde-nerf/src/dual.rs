//! Dual numbers: the exact derivative of generic code in one direction, as the oracle of the hand-derived adjoints.

use crate::scalar::Scalar;
use mde_uncertainty::Real;
use std::cmp::Ordering;
use std::iter::Sum;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

/// \\(x + x' \varepsilon\\) with \\(\varepsilon^2 = 0\\): a value and its derivative in one direction. Comparisons, `max`, `min`
/// and truncation go by the value.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Dual {
    pub(crate) value: f64,
    pub(crate) slope: f64,
}

impl Dual {
    /// The variable that is differentiated.
    pub(crate) fn variable(value: f64) -> Self {
        Self { value, slope: 1.0 }
    }

    /// \\(f(x) + f'(x) x' \varepsilon\\).
    fn chain(self, value: f64, derivative: f64) -> Self {
        Self { value, slope: derivative * self.slope }
    }
}

impl PartialEq for Dual {
    fn eq(&self, other: &Self) -> bool {
        self.value == other.value
    }
}

impl PartialOrd for Dual {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        self.value.partial_cmp(&other.value)
    }
}

impl Add for Dual {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self { value: self.value + other.value, slope: self.slope + other.slope }
    }
}

impl Sub for Dual {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self { value: self.value - other.value, slope: self.slope - other.slope }
    }
}

impl Mul for Dual {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        Self { value: self.value * other.value, slope: self.slope * other.value + self.value * other.slope }
    }
}

impl Div for Dual {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let value = self.value / other.value;
        Self { value, slope: (self.slope - value * other.slope) / other.value }
    }
}

impl Neg for Dual {
    type Output = Self;
    fn neg(self) -> Self {
        Self { value: -self.value, slope: -self.slope }
    }
}

impl AddAssign for Dual {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl Sum for Dual {
    fn sum<I: Iterator<Item = Self>>(terms: I) -> Self {
        terms.fold(Self::ZERO, Self::add)
    }
}

impl Real for Dual {
    const ZERO: Self = Self { value: 0.0, slope: 0.0 };
    const ONE: Self = Self { value: 1.0, slope: 0.0 };

    fn from_f64(value: f64) -> Self {
        Self { value, slope: 0.0 }
    }

    fn to_f64(self) -> f64 {
        self.value
    }

    fn exp(self) -> Self {
        self.chain(self.value.exp(), self.value.exp())
    }

    fn exp_m1(self) -> Self {
        self.chain(self.value.exp_m1(), self.value.exp())
    }

    fn sqrt(self) -> Self {
        self.chain(self.value.sqrt(), 0.5 / self.value.sqrt())
    }
}

impl Scalar for Dual {
    fn sin_pi(self) -> Self {
        self.chain(self.value.sin_pi(), std::f64::consts::PI * self.value.cos_pi())
    }

    fn cos_pi(self) -> Self {
        self.chain(self.value.cos_pi(), -std::f64::consts::PI * self.value.sin_pi())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Every operation against central differences of its value.
        #[test]
        fn derivatives_of_the_operations_agree_with_central_differences(x in 0.2..3.0_f64, c in 0.3..2.0_f64) {
            type Op = fn(Dual, Dual) -> Dual;
            let operations: [Op; 13] = [
                |x, c| x + c,
                |x, c| c - x,
                |x, c| x * c * x,
                |x, c| c / x,
                |x, c| x / (x + c),
                |x, _| -x.exp(),
                |x, _| x.exp_m1(),
                |x, _| x.sqrt(),
                |x, c| (x - c - c).abs(),
                |x, c| x.max(c).min(c + c),
                |x, _| x.sin_pi(),
                |x, _| x.cos_pi(),
                |x, c| x.mul_add(c, x).sigmoid(),
            ];
            // Away from the kinks of abs, max and min.
            prop_assume!((x - c).abs() > 1e-3 && (x - 2.0 * c).abs() > 1e-3);
            let h = 1e-6;
            for (index, operation) in operations.iter().enumerate() {
                let at = |x: f64| operation(Dual::from_f64(x), Dual::from_f64(c)).value;
                let exact = operation(Dual::variable(x), Dual::from_f64(c)).slope;
                let difference = (at(x + h) - at(x - h)) / (2.0 * h);
                prop_assert!((exact - difference).abs() < 1e-7 * (1.0 + exact.abs()), "{}: {} {}", index, exact, difference);
            }
        }
    }
}
