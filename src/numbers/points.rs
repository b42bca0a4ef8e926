//! Glam's vectors and arrays of three numbers as points.

use glam::{DVec3, Vec3};

use crate::numbers::traits::{Located, Movable, Vector, sealed};

macro_rules! points {
    ($t:ty, $vector:ty) => {
        impl sealed::Sealed for $vector {}

        impl Vector<$t> for $vector {
            #[inline(always)]
            fn from_array(xyz: [$t; 3]) -> Self {
                <$vector>::from_array(xyz)
            }
            #[inline(always)]
            fn to_array(self) -> [$t; 3] {
                <$vector>::to_array(&self)
            }
            #[inline(always)]
            fn dot(self, other: Self) -> $t {
                <$vector>::dot(self, other)
            }
        }

        impl Located for $vector {
            type Real = $t;
            #[inline(always)]
            fn position(&self) -> Self {
                *self
            }
        }

        impl Movable for $vector {
            fn moved_by(&self, shift: Self) -> Self {
                *self + shift
            }
        }

        impl Movable for [$t; 3] {
            fn moved_by(&self, shift: $vector) -> Self {
                (self.position() + shift).to_array()
            }
        }

        impl Located for [$t; 3] {
            type Real = $t;
            #[inline(always)]
            fn position(&self) -> $vector {
                <$vector>::from_array(*self)
            }
        }
    };
}

points!(f32, Vec3);
points!(f64, DVec3);
