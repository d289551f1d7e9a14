//! The treatment machine: what its photon beam is like, read from a file.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::arc_limits::ArcLimits;
use super::clearance::FreeRange;
use super::collimator::Collimator;
use super::superposition::Superposition;
use stillpoint_patient::case::Case;

/// A photon beam of a linear accelerator, as the file writes it.
///
/// Dose per unit fluence is a sum of components, each a depth dose times a lateral kernel (Bortfeld, Schlegel, Rhein,
/// Med. Phys. 20 (1993) 311).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MachineFile {
    /// Where the numbers come from and under which licence they may be passed on.
    pub provenance: String,
    /// Nominal energy, MV.
    pub energy_mv: f64,
    /// Distance from the source to the isocentre, mm.
    pub sad_mm: f64,
    /// Distance from the source to the collimator, mm.
    pub scd_mm: f64,
    /// Attenuation in water, 1/mm.
    pub m_per_mm: f64,
    /// Build-up of each component, 1/mm.
    pub betas_per_mm: Vec<f64>,
    /// Full width at half maximum of the Gaussian that blurs the edge of a field, at the isocentre, mm.
    pub penumbra_fwhm_at_iso_mm: f64,
    /// Fluence of the open field over the distance from the axis (mm), relative to the axis.
    pub primary_fluence_r_mm_value: Vec<[f64; 2]>,
    /// Distances from the axis at which the kernels stand, mm.
    pub kernel_pos_mm: Vec<f64>,
    /// Distances from the source to the skin at which the kernels stand, mm.
    pub ssd_mm: Vec<f64>,
    /// Kernels, 1/mm^2: of each component, at each distance to the skin, at each distance from the axis.
    pub kernels_per_mm2: Vec<Vec<Vec<f64>>>,
    /// Relative electron density over Hounsfield units.
    pub hu_to_density: Vec<[f64; 2]>,
    /// The multileaf collimator; without one, fluences are not sequenced.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub collimator: Option<Collimator>,
    /// Spectrum and point kernels; without them, there is no dose by superposition.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub superposition: Option<Superposition>,
    /// Angles of gantry and couch that are free of collisions; without them, those of [`FreeRange::generic`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub free_angles: Option<Vec<FreeRange>>,
    /// How fast gantry, leaves and dose may be in an arc; without it, those of [`ArcLimits::generic`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub arc: Option<ArcLimits>,
    /// Of which beam the pencil kernels are: another one than that of the other fields makes doses by pencil beams wrong.
    #[serde(default, skip_serializing_if = "PencilsOf::is_machine")]
    pub pencils_of: PencilsOf,
}

/// The beam that `m_per_mm`, `betas_per_mm` and `kernels_per_mm2` of a machine file belong to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PencilsOf {
    /// That of the file.
    #[default]
    Machine,
    /// That of the machine from which the other fields were fitted to measured doses.
    Start,
}

impl PencilsOf {
    fn is_machine(&self) -> bool {
        *self == Self::Machine
    }
}

/// A machine that holds together. Only this one computes dose.
#[derive(Clone, Debug, PartialEq)]
pub struct Machine(MachineFile);

/// Why a machine file cannot be used.
#[derive(Debug, Error)]
pub enum MachineError {
    /// It is not JSON of the expected form.
    #[error("the machine file is not what a machine file is: {0}")]
    Form(#[from] serde_json::Error),
    /// A number is out of its range.
    #[error("`{field}` of the machine file is {value}; it must be {must}")]
    Number {
        /// Field of the file.
        field: &'static str,
        /// What it holds.
        value: f64,
        /// What it may hold.
        must: &'static str,
    },
    /// A table has the wrong size.
    #[error("`{field}` of the machine file has {found} entries; it must have {must}")]
    Size {
        /// Field of the file.
        field: &'static str,
        /// Its entries.
        found: usize,
        /// How many there must be.
        must: String,
    },
    /// A table is not in order.
    #[error("`{field}` of the machine file must rise; entry {entry} does not")]
    Order {
        /// Field of the file.
        field: &'static str,
        /// The first entry that does not rise.
        entry: usize,
    },
}

/// Number of components that dose is a sum of.
pub(crate) const COMPONENTS: usize = 3;
/// Entries that a table of the file may have.
const TABLE: std::ops::RangeInclusive<usize> = 1..=4096;

impl MachineFile {
    /// The file's text, one field to a line.
    pub fn to_json(&self) -> Result<String, MachineError> {
        let serde_json::Value::Object(fields) = serde_json::to_value(self)? else { return Ok(String::new()) };
        let lines: Vec<String> =
            fields.iter().map(|(field, value)| format!("  \"{field}\": {value}")).collect();
        Ok(format!("{{\n{}\n}}\n", lines.join(",\n")))
    }
}

impl Machine {
    /// The machine that comes with the project: generic 6 MV photons, made by [`MachineFile::generic_6mv`], with spectrum
    /// and point kernels of `tools/research/kernels`.
    pub fn shipped() -> Result<Self, MachineError> {
        Self::from_json(include_str!("../../data/generic_6mv.json"))
    }

    /// Reads a machine file.
    pub fn from_json(json: &str) -> Result<Self, MachineError> {
        Self::new(serde_json::from_str(json)?)
    }

    /// Angles of gantry and couch that are free of collisions.
    pub fn free_angles(&self) -> Vec<FreeRange> {
        self.0.free_angles.clone().unwrap_or_else(FreeRange::generic)
    }

    /// How fast gantry, leaves and dose may be in an arc.
    pub fn arc_limits(&self) -> ArcLimits {
        self.0.arc.unwrap_or(ArcLimits::generic())
    }

    /// The machine that a file describes, if its numbers fit each other.
    pub fn new(file: MachineFile) -> Result<Self, MachineError> {
        in_range("energy_mv", file.energy_mv, 1.0..=50.0, "from 1 to 50 MV")?;
        in_range("sad_mm", file.sad_mm, 500.0..=5000.0, "from 500 to 5000 mm")?;
        in_range("scd_mm", file.scd_mm, 0.0..=file.sad_mm, "from 0 to `sad_mm`")?;
        in_range("m_per_mm", file.m_per_mm, 1e-5..=0.1, "from 0.00001 to 0.1 per mm")?;
        in_range("penumbra_fwhm_at_iso_mm", file.penumbra_fwhm_at_iso_mm, 0.1..=50.0, "from 0.1 to 50 mm")?;
        size("betas_per_mm", file.betas_per_mm.len(), COMPONENTS..=COMPONENTS)?;
        for &beta in &file.betas_per_mm {
            in_range("betas_per_mm", beta, 1e-5..=10.0, "from 0.00001 to 10 per mm")?;
            if (beta - file.m_per_mm).abs() < 1e-9 {
                return Err(MachineError::Number {
                    field: "betas_per_mm",
                    value: beta,
                    must: "other than `m_per_mm`",
                });
            }
        }
        file.arc.iter().try_for_each(ArcLimits::check)?;
        FreeRange::check(file.free_angles.as_deref().unwrap_or(&FreeRange::generic()))?;
        table("primary_fluence_r_mm_value", &file.primary_fluence_r_mm_value, 0.0..=100.0, "from 0 to 100")?;
        table("hu_to_density", &file.hu_to_density, 0.0..=25.0, "from 0 to 25")?;
        rising("kernel_pos_mm", &file.kernel_pos_mm)?;
        in_range("kernel_pos_mm", file.kernel_pos_mm[0], 0.0..=0.0, "0 in its first entry")?;
        rising("ssd_mm", &file.ssd_mm)?;
        size("kernels_per_mm2", file.kernels_per_mm2.len(), COMPONENTS..=COMPONENTS)?;
        for of_component in &file.kernels_per_mm2 {
            size("kernels_per_mm2[component]", of_component.len(), file.ssd_mm.len()..=file.ssd_mm.len())?;
            for kernel in of_component {
                let positions = file.kernel_pos_mm.len();
                size("kernels_per_mm2[component][ssd]", kernel.len(), positions..=positions)?;
                for &value in kernel {
                    in_range("kernels_per_mm2", value, -1e6..=1e6, "a number between -1e6 and 1e6")?;
                }
            }
        }
        file.collimator.iter().try_for_each(Collimator::check)?;
        file.superposition.iter().try_for_each(Superposition::check)?;
        Ok(Self(file))
    }

    /// What the file holds.
    pub fn file(&self) -> &MachineFile {
        &self.0
    }

    /// What a person should know of doses by pencil beams of this machine; nothing where the kernels are its own.
    pub fn pencil_caution(&self) -> Option<String> {
        (self.0.pencils_of == PencilsOf::Start).then(|| {
            "dose by pencil beams of another machine: spectrum, penumbra, fluence and monitor units of the machine file were \
             fitted to measured doses, and its pencil kernels are those of the machine from which the fit started; the engine \
             `superposition` has the fitted beam"
                .to_owned()
        })
    }

    /// Relative electron density of a Hounsfield unit; the table's ends hold beyond it.
    pub fn density(&self, hounsfield: f64) -> f64 {
        interpolate(&self.0.hu_to_density, hounsfield)
    }

    /// What of a patient has Hounsfield units beyond the ends of the table, where its ends hold: a sentence each.
    pub fn beyond_table(&self, case: &Case) -> Vec<String> {
        let table = &self.0.hu_to_density;
        let (Some(external), Some([low, least]), Some([high, most])) =
            (case.external(), table.first(), table.last())
        else {
            return Vec::new();
        };
        let hu = |voxel: usize| f64::from(case.hu()[voxel]);
        let warning = |is_beyond: &dyn Fn(f64) -> bool, side: &str, end: f64, density: f64| {
            let beyond = || external.mask.indices().map(hu).filter(|hu| is_beyond(*hu));
            let farthest = beyond().max_by(|a, b| (a - end).abs().total_cmp(&(b - end).abs()))?;
            let cm3 = beyond().count() as f64 * case.grid().voxel_cm3();
            Some(format!(
                "{cm3:.2} cm3 of the patient have {side} {end} HU (as far as {farthest}), where `hu_to_density` of the machine \
                 ends: they count with its density of {density}; give a machine file whose table goes on"
            ))
        };
        let above = warning(&|hu| hu > *high, "above", *high, *most);
        let below = warning(&|hu| hu < *low, "below", *low, *least);
        above.into_iter().chain(below).collect()
    }

    /// Fluence of the open field at a distance from the axis (mm at the isocentre), relative to the axis.
    pub fn primary_fluence(&self, distance_mm: f64) -> f64 {
        interpolate(&self.0.primary_fluence_r_mm_value, distance_mm)
    }

    /// Depth dose of each component at a radiological depth (mm of water): Bortfeld 1993 (10).
    pub fn depth_dose(&self, depth_mm: f64) -> [f64; COMPONENTS] {
        let m = self.0.m_per_mm;
        std::array::from_fn(|component| {
            let beta = self.0.betas_per_mm[component];
            beta / (beta - m) * (libm::exp(-m * depth_mm) - libm::exp(-beta * depth_mm))
        })
    }

    /// Kernels of each component for a distance to the skin, over `kernel_pos_mm`: those of the nearest distance.
    pub(crate) fn kernels_at(&self, ssd_mm: f64) -> [&[f64]; COMPONENTS] {
        let away = |place: &usize| (self.0.ssd_mm[*place] - ssd_mm).abs();
        let nearest = (0..self.0.ssd_mm.len()).min_by(|a, b| away(a).total_cmp(&away(b))).unwrap_or(0);
        std::array::from_fn(|component| self.0.kernels_per_mm2[component][nearest].as_slice())
    }
}

pub(crate) fn in_range(
    field: &'static str,
    value: f64,
    range: std::ops::RangeInclusive<f64>,
    must: &'static str,
) -> Result<(), MachineError> {
    if range.contains(&value) { Ok(()) } else { Err(MachineError::Number { field, value, must }) }
}

pub(crate) fn size(
    field: &'static str,
    found: usize,
    range: std::ops::RangeInclusive<usize>,
) -> Result<(), MachineError> {
    if range.contains(&found) {
        return Ok(());
    }
    let must = if range.start() == range.end() {
        range.start().to_string()
    } else {
        format!("{} to {}", range.start(), range.end())
    };
    Err(MachineError::Size { field, found, must })
}

pub(crate) fn rising(field: &'static str, values: &[f64]) -> Result<(), MachineError> {
    size(field, values.len(), TABLE)?;
    for &value in values {
        in_range(field, value, -1e5..=1e5, "a number between -100000 and 100000")?;
    }
    match values.windows(2).position(|pair| pair[0] >= pair[1]) {
        None => Ok(()),
        Some(before) => Err(MachineError::Order { field, entry: before + 1 }),
    }
}

/// A table of pairs: the first numbers rise, the second lie in a range.
fn table(
    field: &'static str,
    pairs: &[[f64; 2]],
    range: std::ops::RangeInclusive<f64>,
    must: &'static str,
) -> Result<(), MachineError> {
    rising(field, &pairs.iter().map(|pair| pair[0]).collect::<Vec<_>>())?;
    pairs.iter().try_for_each(|pair| in_range(field, pair[1], range.clone(), must))
}

/// Linear between the table's pairs; the ends hold beyond them.
fn interpolate(pairs: &[[f64; 2]], at: f64) -> f64 {
    let after = pairs.partition_point(|pair| pair[0] <= at);
    let (Some(&[x0, y0]), Some(&[x1, y1])) = (pairs.get(after.wrapping_sub(1)), pairs.get(after)) else {
        return if after == 0 { pairs[0][1] } else { pairs[after - 1][1] };
    };
    y0 + (y1 - y0) * (at - x0) / (x1 - x0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A machine of the least size.
    pub(crate) fn small() -> MachineFile {
        MachineFile {
            provenance: "a test".into(),
            energy_mv: 6.0,
            sad_mm: 1000.0,
            scd_mm: 500.0,
            m_per_mm: 0.005,
            betas_per_mm: vec![0.3, 0.02, 0.004],
            penumbra_fwhm_at_iso_mm: 5.0,
            primary_fluence_r_mm_value: vec![[0.0, 1.0], [100.0, 1.1]],
            kernel_pos_mm: vec![0.0, 100.0],
            ssd_mm: vec![900.0],
            kernels_per_mm2: vec![vec![vec![1.0, 0.0]]; 3],
            hu_to_density: vec![[-1000.0, 0.0], [0.0, 1.0], [1000.0, 1.5]],
            collimator: None,
            superposition: None,
            free_angles: None,
            arc: None,
            pencils_of: PencilsOf::Machine,
        }
    }

    fn fault(change: impl FnOnce(&mut MachineFile)) -> String {
        let mut file = small();
        change(&mut file);
        Machine::new(file).unwrap_err().to_string()
    }

    #[test]
    fn faults_name_the_field_and_what_it_must_be() {
        assert_eq!(
            fault(|f| f.sad_mm = f64::NAN),
            "`sad_mm` of the machine file is NaN; it must be from 500 to 5000 mm"
        );
        assert_eq!(
            fault(|f| f.betas_per_mm[1] = 0.005),
            "`betas_per_mm` of the machine file is 0.005; it must be other than `m_per_mm`"
        );
        assert_eq!(
            fault(|f| f.betas_per_mm.truncate(2)),
            "`betas_per_mm` of the machine file has 2 entries; it must have 3"
        );
        assert_eq!(
            fault(|f| f.hu_to_density[2][0] = -5.0),
            "`hu_to_density` of the machine file must rise; entry 2 does not"
        );
        assert_eq!(
            fault(|f| f.kernels_per_mm2[2][0].push(0.0)),
            "`kernels_per_mm2[component][ssd]` of the machine file has 3 entries; it must have 2"
        );
        assert_eq!(
            fault(|f| f.ssd_mm.clear()),
            "`ssd_mm` of the machine file has 0 entries; it must have 1 to 4096"
        );
    }

    #[test]
    fn unknown_and_missing_fields_are_named_with_their_place() {
        let text = serde_json::to_string(&small()).unwrap();
        let misspelt = Machine::from_json(&text.replace("scd_mm", "sdc_mm")).unwrap_err().to_string();
        assert!(misspelt.contains("unknown field `sdc_mm`") && misspelt.contains("line 1"), "{misspelt}");
        assert!(Machine::from_json(&text).is_ok());
    }

    #[test]
    fn tables_are_linear_between_entries_and_hold_beyond_them() {
        let machine = Machine::new(small()).unwrap();
        assert_eq!(
            [-2000.0, -500.0, 0.0, 500.0, 3000.0].map(|hu| machine.density(hu)),
            [0.0, 0.5, 1.0, 1.25, 1.5]
        );
        assert_eq!([0.0, 50.0, 400.0].map(|r| machine.primary_fluence(r)), [1.0, 1.05, 1.1]);
    }

    #[test]
    fn hounsfield_units_beyond_the_table_are_said_with_their_volume() {
        let case = stillpoint_patient::case::phantom(0).unwrap();
        let shipped = Machine::shipped().unwrap();
        assert_eq!(shipped.beyond_table(&case), Vec::<String>::new());
        let short = MachineFile { hu_to_density: vec![[-1000.0, 0.0], [-500.0, 0.5]], ..small() };
        let warning = Machine::new(short).unwrap().beyond_table(&case);
        let above = |hu: f64| {
            let body = &case.external().unwrap().mask;
            body.indices().filter(|v| f64::from(case.hu()[*v]) > hu).count() as f64 * case.grid().voxel_cm3()
        };
        assert_eq!(warning.len(), 1);
        let text = format!("{:.2} cm3 of the patient have above -500 HU", above(-500.0));
        assert!(warning[0].starts_with(&text) && warning[0].contains("density of 0.5"), "{warning:?}");
    }

    #[test]
    fn depth_dose_starts_at_0_and_is_greatest_where_its_slope_is_0() {
        let machine = Machine::new(small()).unwrap();
        assert_eq!(machine.depth_dose(0.0), [0.0; 3]);
        for (component, beta) in [0.3, 0.02, 0.004].into_iter().enumerate() {
            let top = libm::log(beta / 0.005) / (beta - 0.005);
            let at = |depth| machine.depth_dose(depth)[component];
            assert!(at(top) > at(top - 1.0) && at(top) > at(top + 1.0));
        }
    }
}
