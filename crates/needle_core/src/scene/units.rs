//! Numbers that carry their unit in their type. Values are SI; ranges are checked where a scene is validated.

macro_rules! unit {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, PartialOrd, Default)]
        pub struct $name(pub f64);
        impl $name {
            /// The bare number, in the unit that the type names.
            #[must_use]
            pub const fn get(self) -> f64 {
                self.0
            }
        }
    };
}

unit!(
    /// A length, m.
    Metres
);
unit!(
    /// A stress or modulus, Pa.
    Pascals
);
unit!(
    /// A mass density, kg/m^3.
    KilogramsPerCubicMetre
);
unit!(
    /// A speed, m/s.
    MetresPerSecond
);
unit!(
    /// A rate, 1/s.
    Hertz
);
unit!(
    /// An angle, rad.
    Radians
);
unit!(
    /// A time, s.
    Seconds
);
unit!(
    /// Poisson's ratio, in (-1, 0.5).
    PoissonRatio
);
