//! Hexahedra among the cells of a scene (`discretisation.cells`), in builds with the feature `research`.

use mtled::cloud::Cloud;

#[cfg(feature = "research")]
pub(super) use built::{grid, integrated, with_bricks};
#[cfg(not(feature = "research"))]
pub(super) use left_out::{grid, integrated, with_bricks};

/// A hexahedron lies in one region: that of most of its tetrahedra.
pub(super) fn in_one_region(cloud: &Cloud, region: &mut [u8]) {
    for hexahedron in &cloud.hexahedra {
        let mut own: Vec<u8> = hexahedron.cells.iter().map(|&c| region[c as usize]).collect();
        own.sort_unstable();
        hexahedron.cells.iter().for_each(|&c| region[c as usize] = own[own.len() / 2]);
    }
}

#[cfg(feature = "research")]
mod built {
    use mtled::approximation::table::Approximation;
    use mtled::cloud::{Cloud, Domain, Spacing};

    use crate::scene::Scene;
    use crate::twin::BuildError;

    /// A whole cylinder or box of hexahedra.
    pub(crate) fn grid(domain: &Domain, spacing: &Spacing) -> Result<Cloud, BuildError> {
        mtled_hexahedra::structured(domain, spacing).map_err(|e| BuildError::Cloud(e.to_string()))
    }

    /// Hexahedra where there is room, and tetrahedra around them.
    pub(crate) fn with_bricks(domain: &Domain, spacing: &Spacing) -> Result<Cloud, BuildError> {
        let cloud = mtled_hexahedra::with_bricks(domain, spacing).map_err(|e| BuildError::Cloud(e.to_string()))?;
        if cloud.hexahedra.is_empty() {
            let reason = "discretisation.cells: no hexahedron has room between surface, interfaces and path: use a smaller spacing_m, or tetrahedra";
            return Err(BuildError::Cloud(reason.to_owned()));
        }
        Ok(cloud)
    }

    /// With the points of hexahedra; a hexahedron whose tetrahedra have four points each has eight.
    pub(crate) fn integrated(
        approximation: Approximation,
        scene: &Scene,
        cloud: &Cloud,
        four: impl Fn(usize) -> bool,
    ) -> Result<Approximation, BuildError> {
        let Cloud { points, cells, hexahedra, .. } = cloud;
        let eight = |cell: usize| scene.discretisation.cells.points_per_hexahedron() > 1 || four(cell);
        Ok(mtled_hexahedra::integrated(approximation, points, cells, hexahedra, eight))
    }
}

/// A scene file that asks for hexahedra is refused before; a program can still put them into a [`crate::scene::Scene`].
#[cfg(not(feature = "research"))]
mod left_out {
    use mtled::approximation::table::Approximation;
    use mtled::cloud::{Cloud, Domain, Spacing};

    use crate::scene::Scene;
    use crate::twin::BuildError;

    fn refused<T>() -> Result<T, BuildError> {
        Err(BuildError::Unsupported {
            key: "discretisation.cells",
            reason: "hexahedra are for research, and this build has none: build with `--features research`, or use tetrahedra",
        })
    }

    pub(crate) fn grid(_: &Domain, _: &Spacing) -> Result<Cloud, BuildError> {
        refused()
    }

    pub(crate) fn with_bricks(_: &Domain, _: &Spacing) -> Result<Cloud, BuildError> {
        refused()
    }

    pub(crate) fn integrated(
        _: Approximation,
        _: &Scene,
        _: &Cloud,
        _: impl Fn(usize) -> bool,
    ) -> Result<Approximation, BuildError> {
        refused()
    }
}
