use std::fmt::Debug;
use std::iter::Sum;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

/// The scalar that the formulas are written in: `f32` for speed, `f64` as the reference.
///
/// `num_traits::Float` has some sixty functions, of which the formulas need these; a scalar that carries derivatives can
/// implement them, and their constants are constants.
pub trait Real:
    Copy
    + Default
    + Debug
    + PartialOrd
    + Send
    + Sync
    + 'static
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + Sum
{
    /// 0.
    const ZERO: Self;
    /// 1.
    const ONE: Self;
    /// The nearest value of this type.
    fn from_f64(value: f64) -> Self;
    /// The value as `f64`, exactly.
    fn to_f64(self) -> f64;
    /// \\(e^x\\).
    fn exp(self) -> Self;
    /// \\(e^x - 1\\), exact near 0.
    fn exp_m1(self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// Absolute value.
    fn abs(self) -> Self {
        if self < Self::ZERO { -self } else { self }
    }
    /// The larger of two.
    fn max(self, other: Self) -> Self {
        if self >= other { self } else { other }
    }
    /// The smaller of two.
    fn min(self, other: Self) -> Self {
        if self <= other { self } else { other }
    }
}

/// Functions that the type has itself.
macro_rules! inherent {
    ($($name:ident($($other:ident)?)),*) => {$(
        #[inline(always)]
        fn $name(self $(, $other: Self)?) -> Self {
            Self::$name(self $(, $other)?)
        }
    )*};
}

macro_rules! real {
    ($type:ty) => {
        impl Real for $type {
            const ZERO: Self = 0.0;
            const ONE: Self = 1.0;
            #[inline(always)]
            fn from_f64(value: f64) -> Self {
                value as Self
            }
            #[inline(always)]
            fn to_f64(self) -> f64 {
                f64::from(self)
            }
            inherent!(exp(), exp_m1(), sqrt(), abs(), max(other), min(other));
        }
    };
}

real!(f32);
real!(f64);
