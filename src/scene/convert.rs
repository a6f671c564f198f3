//! Raw values to typed scene and back: one line per key in each direction.

use crate::scene::Word;
use mtled::material::{Ogden, Prony};

use super::values::Values;
use super::{
    Discretisation, Grading, Hertz, Instrument, InstrumentKind, KilogramsPerCubicMetre, Material, MaterialModel,
    MeshFile, Metres, MetresPerSecond, Motion, Needle, Pascals, PoissonRatio, Radians, Sample, Scene, SceneError,
    Seconds, Shape, Stepping, Target, Value,
};

/// The typed scene. Types and ranges hold already; what is absent and required is an error here.
pub(super) fn to_scene(v: &Values) -> Result<Scene, SceneError> {
    v.check_applicability()?;
    Ok(Scene {
        name: if v.has("name") { text(v, "name")? } else { stem(v.origin()).to_owned() },
        description: text(v, "description")?,
        sample: sample(v)?,
        material: material(v)?,
        instrument: v.has_section("instrument").then(|| instrument(v)).transpose()?,
        discretisation: discretisation(v)?,
        stepping: stepping(v)?,
        motion: v.has_section("motion").then(|| motion(v)).transpose()?,
        targets: (0..v.targets()).map(|i| target(v, i)).collect::<Result<_, _>>()?,
    })
}

fn sample(v: &Values) -> Result<Sample, SceneError> {
    let height = || metres(v, "sample.height_m");
    let shape = match text(v, "sample.shape")?.as_str() {
        "mesh" => Shape::Mesh(MeshFile {
            path: text(v, "sample.mesh")?,
            unit_m: real(v, "sample.mesh_unit_m")?,
            base_group: text(v, "sample.base_group")?,
            contact_group: text(v, "sample.contact_group")?,
        }),
        "box" => Shape::Box {
            height: height()?,
            size_x: metres(v, "sample.size_x_m")?,
            size_y: metres(v, "sample.size_y_m")?,
        },
        _ => Shape::Cylinder { height: height()?, diameter: metres(v, "sample.diameter_m")? },
    };
    Ok(Sample { shape })
}

fn material(v: &Values) -> Result<Material, SceneError> {
    let model = word(v, "material.model")?;
    let ogden = match model {
        MaterialModel::NeoHookean => Ogden::default(),
        MaterialModel::Ogden => {
            pair(v, "material.ogden_exponents", "material.ogden_shear_moduli_pa", |exponents, moduli| {
                Ogden::new(moduli, exponents)
            })?
        }
    };
    Ok(Material {
        model,
        shear_modulus: match model {
            MaterialModel::NeoHookean => Pascals(real(v, "material.shear_modulus_pa")?),
            MaterialModel::Ogden => Pascals(ogden.shear_modulus()),
        },
        ogden,
        volumetric: word(v, "material.volumetric")?,
        prony: pair(v, "material.prony_times_s", "material.prony_shares", |times, shares| Prony::new(shares, times))?,
        poisson_ratio: PoissonRatio(real(v, "material.poisson_ratio")?),
        density: KilogramsPerCubicMetre(real(v, "material.density_kg_per_m3")?),
    })
}

fn instrument(v: &Values) -> Result<Instrument, SceneError> {
    let kind = match text(v, "instrument.kind")?.as_str() {
        "plate" => return Ok(Instrument { kind: InstrumentKind::Plate, entry: [Metres(0.0); 2] }),
        "indenter" => InstrumentKind::Indenter { diameter: metres(v, "instrument.diameter_m")? },
        _ => InstrumentKind::Needle(Needle {
            diameter: metres(v, "instrument.diameter_m")?,
            capture_radius: metres(v, "instrument.capture_radius_m")?,
            deformation_coefficient: real(v, "instrument.deformation_coefficient")?,
            retraction_coefficient: real(v, "instrument.retraction_coefficient")?,
            deformation_rule: word(v, "instrument.deformation_rule")?,
            puncture_strain: real(v, "instrument.puncture_strain")?,
            tilt: Radians(real(v, "instrument.tilt_rad")?),
            azimuth: Radians(real(v, "instrument.azimuth_rad")?),
        }),
    };
    Ok(Instrument { kind, entry: [metres(v, "instrument.entry_x_m")?, metres(v, "instrument.entry_y_m")?] })
}

fn discretisation(v: &Values) -> Result<Discretisation, SceneError> {
    Ok(Discretisation {
        method: word(v, "discretisation.method")?,
        dimension: word(v, "discretisation.dimension")?,
        grading: (text(v, "sample.shape")? != "mesh").then(|| grading(v)).transpose()?,
        support_factor: real(v, "discretisation.support_factor")?,
        penalty: real(v, "discretisation.penalty")?,
        points_per_cell: whole(v, "discretisation.points_per_cell")?,
        cells_per_point: whole(v, "discretisation.cells_per_point")?,
        volume_ratio: word(v, "discretisation.volume_ratio")?,
        fold_guard: matches!(v.value("discretisation.fold_guard")?, Value::Boolean(true)),
        precision: word(v, "discretisation.precision")?,
    })
}

fn grading(v: &Values) -> Result<Grading, SceneError> {
    Ok(Grading {
        spacing: metres(v, "discretisation.spacing_m")?,
        edge_refinement: real(v, "discretisation.edge_refinement")?,
        growth: real(v, "discretisation.growth")?,
    })
}

fn stepping(v: &Values) -> Result<Stepping, SceneError> {
    Ok(Stepping {
        tolerance: real(v, "stepping.tolerance")?,
        step_factor: real(v, "stepping.step_factor")?,
        max_steps_per_pose: whole(v, "stepping.max_steps_per_pose")?,
        min_steps_per_pose: whole(v, "stepping.min_steps_per_pose")?,
    })
}

fn motion(v: &Values) -> Result<Motion, SceneError> {
    Ok(Motion {
        depth: metres(v, "motion.depth_m")?,
        speed: MetresPerSecond(real(v, "motion.speed_m_per_s")?),
        pose_rate: Hertz(real(v, "motion.pose_hz")?),
        hold: Seconds(real(v, "motion.hold_s")?),
        retract: matches!(v.value("motion.retract")?, Value::Boolean(true)),
    })
}

fn target(v: &Values, i: usize) -> Result<Target, SceneError> {
    let path = format!("targets.{i}.position_m");
    let Value::Point(position) = v.value(&path)? else { return Err(not_of_type(v, &path)) };
    Ok(Target { name: text(v, &format!("targets.{i}.name"))?, position })
}

fn real(v: &Values, path: &str) -> Result<f64, SceneError> {
    v.value(path)?.as_real().ok_or_else(|| not_of_type(v, path))
}

fn list(v: &Values, path: &str) -> Result<Vec<f64>, SceneError> {
    v.value(path)?.as_list().ok_or_else(|| not_of_type(v, path))
}

/// What two lists of the same length make.
fn pair<T>(v: &Values, first: &str, second: &str, make: impl Fn(&[f64], &[f64]) -> Option<T>) -> Result<T, SceneError> {
    let (a, b) = (list(v, first)?, list(v, second)?);
    // the lengths of both lists are in range, so they can only differ
    make(&a, &b).ok_or_else(|| SceneError::Inconsistent {
        place: v.place(first),
        key: first.to_owned(),
        value: Value::from(a.clone()).to_string(),
        reason: format!("{} numbers, but {second} has {}: one of each makes a term", a.len(), b.len()),
    })
}

fn metres(v: &Values, path: &str) -> Result<Metres, SceneError> {
    real(v, path).map(Metres)
}

fn whole(v: &Values, path: &str) -> Result<u32, SceneError> {
    match v.value(path)? {
        Value::Integer(i) => u32::try_from(i).map_err(|_| not_of_type(v, path)),
        _ => Err(not_of_type(v, path)),
    }
}

fn text(v: &Values, path: &str) -> Result<String, SceneError> {
    v.value(path)?.as_text().map(str::to_owned).ok_or_else(|| not_of_type(v, path))
}

fn word<T: Word>(v: &Values, path: &str) -> Result<T, SceneError> {
    T::from_word(&text(v, path)?).ok_or_else(|| not_of_type(v, path))
}

/// Only reached if registry and types disagree, which a test over every key rules out.
fn not_of_type(v: &Values, path: &str) -> SceneError {
    SceneError::Inconsistent {
        place: v.place(path),
        key: path.to_owned(),
        value: v.get(path).map_or_else(|| "default".to_owned(), Value::to_string),
        reason: "not of the key's type".to_owned(),
    }
}

/// A file's name without folders and `.toml`: what a scene is called where it doesn't say.
fn stem(origin: &str) -> &str {
    let file = origin.rsplit(['/', '\\']).next().unwrap_or(origin);
    file.strip_suffix(".toml").unwrap_or(file)
}

/// Every key of a scene that applies to it, defaults included.
pub(super) fn to_values(scene: &Scene) -> Values {
    let mut v = Values::new(&format!("scene {}", scene.name));
    v.put("name", scene.name.as_str());
    v.put("description", scene.description.as_str());
    put_sample(&mut v, &scene.sample);
    put_material(&mut v, &scene.material);
    if let Some(instrument) = &scene.instrument {
        put_instrument(&mut v, instrument);
    }
    put_discretisation(&mut v, &scene.discretisation);
    v.put("stepping.tolerance", scene.stepping.tolerance);
    v.put("stepping.step_factor", scene.stepping.step_factor);
    v.put("stepping.max_steps_per_pose", scene.stepping.max_steps_per_pose);
    v.put("stepping.min_steps_per_pose", scene.stepping.min_steps_per_pose);
    if let Some(motion) = &scene.motion {
        v.put("motion.depth_m", motion.depth.get());
        v.put("motion.speed_m_per_s", motion.speed.get());
        v.put("motion.pose_hz", motion.pose_rate.get());
        v.put("motion.hold_s", motion.hold.get());
        v.put("motion.retract", motion.retract);
    }
    for (i, target) in scene.targets.iter().enumerate() {
        v.put(&format!("targets.{i}.name"), target.name.as_str());
        v.put(&format!("targets.{i}.position_m"), target.position);
    }
    v
}

fn put_sample(v: &mut Values, sample: &Sample) {
    v.put("sample.shape", sample.shape.as_str());
    match &sample.shape {
        Shape::Cylinder { diameter, height } => {
            v.put("sample.diameter_m", diameter.get());
            v.put("sample.height_m", height.get());
        }
        Shape::Box { size_x, size_y, height } => {
            v.put("sample.size_x_m", size_x.get());
            v.put("sample.size_y_m", size_y.get());
            v.put("sample.height_m", height.get());
        }
        Shape::Mesh(mesh) => {
            v.put("sample.mesh", mesh.path.as_str());
            v.put("sample.mesh_unit_m", mesh.unit_m);
            v.put("sample.base_group", mesh.base_group.as_str());
            v.put("sample.contact_group", mesh.contact_group.as_str());
        }
    }
}

fn put_material(v: &mut Values, material: &Material) {
    v.put("material.model", material.model.as_str());
    match material.model {
        MaterialModel::NeoHookean => v.put("material.shear_modulus_pa", material.shear_modulus.get()),
        MaterialModel::Ogden => {
            let terms = material.ogden.terms();
            v.put("material.ogden_shear_moduli_pa", terms.iter().map(|t| t.shear_modulus).collect::<Vec<_>>());
            v.put("material.ogden_exponents", terms.iter().map(|t| t.exponent).collect::<Vec<_>>());
        }
    }
    v.put("material.volumetric", material.volumetric.as_str());
    v.put("material.prony_shares", material.prony.shares().to_vec());
    v.put("material.prony_times_s", material.prony.times().to_vec());
    v.put("material.poisson_ratio", material.poisson_ratio.get());
    v.put("material.density_kg_per_m3", material.density.get());
}

fn put_instrument(v: &mut Values, instrument: &Instrument) {
    v.put("instrument.kind", instrument.kind.as_str());
    match &instrument.kind {
        InstrumentKind::Plate => return, // it covers the whole face: no entry point
        InstrumentKind::Indenter { diameter } => v.put("instrument.diameter_m", diameter.get()),
        InstrumentKind::Needle(needle) => {
            v.put("instrument.diameter_m", needle.diameter.get());
            v.put("instrument.capture_radius_m", needle.capture_radius.get());
            v.put("instrument.deformation_coefficient", needle.deformation_coefficient);
            v.put("instrument.retraction_coefficient", needle.retraction_coefficient);
            v.put("instrument.deformation_rule", needle.deformation_rule.as_str());
            v.put("instrument.puncture_strain", needle.puncture_strain);
            v.put("instrument.tilt_rad", needle.tilt.get());
            v.put("instrument.azimuth_rad", needle.azimuth.get());
        }
    }
    v.put("instrument.entry_x_m", instrument.entry[0].get());
    v.put("instrument.entry_y_m", instrument.entry[1].get());
}

fn put_discretisation(v: &mut Values, d: &Discretisation) {
    v.put("discretisation.method", d.method.as_str());
    v.put("discretisation.dimension", d.dimension.as_str());
    if let Some(grading) = &d.grading {
        v.put("discretisation.spacing_m", grading.spacing.get());
        v.put("discretisation.edge_refinement", grading.edge_refinement);
        v.put("discretisation.growth", grading.growth);
    }
    v.put("discretisation.support_factor", d.support_factor);
    v.put("discretisation.penalty", d.penalty);
    v.put("discretisation.points_per_cell", d.points_per_cell);
    v.put("discretisation.cells_per_point", d.cells_per_point);
    v.put("discretisation.volume_ratio", d.volume_ratio.as_str());
    v.put("discretisation.fold_guard", d.fold_guard);
    v.put("discretisation.precision", d.precision.as_str());
}
