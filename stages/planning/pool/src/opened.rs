//! Arguments of calls, opened and checked, of bounded size. They are opened by whoever computes, and not by the thread that
//! greets: a large one takes longer than the silence after which a worker counts as gone.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use stillpoint_map::MappedFile;
use stillpoint_network::Model;
use stillpoint_patient::case;
use stillpoint_plan::dose::{BeamAngles, BeamFile, DoseEngine};
use stillpoint_plan::fluence::{Goals, Plan};

use crate::call::BeamDoses;
use crate::{Call, CallError, Hash, Ready, Store, StoreError, answer, goals};

/// Arguments that calls share, so that each is read once. The one used longest ago goes first.
pub struct Opened {
    most: u64,
    bytes: u64,
    uses: u64,
    items: BTreeMap<Hash, (u64, u64, Item)>,
}

/// The files of the arguments of a call. They can be read although the store has made room since.
pub struct Files(BTreeMap<Hash, (PathBuf, Option<MappedFile>)>);

impl Files {
    /// Of these contents.
    ///
    /// # Errors
    /// One of them is not there.
    pub fn of(store: &mut Store, contents: Vec<Hash>) -> Result<Self, StoreError> {
        let file = |hash: Hash| Ok((hash, (store.path(&hash), Some(store.read(&hash)?))));
        contents.into_iter().map(file).collect::<Result<_, _>>().map(Self)
    }

    fn take(&mut self, hash: &Hash) -> Result<MappedFile, StoreError> {
        let (path, mapped) = self.0.get_mut(hash).ok_or(StoreError::Missing(*hash))?;
        match mapped.take() {
            Some(mapped) => Ok(mapped),
            // Less memory than the arguments of one call: it is opened once more.
            None => MappedFile::open(path).map_err(|error| StoreError::Read { hash: *hash, error }),
        }
    }
}

#[derive(Clone)]
enum Item {
    Engine(Arc<DoseEngine>),
    Dose(Arc<BeamFile>),
    Goals(Arc<Goals>),
    Plan(Arc<Plan>),
    Network(Arc<Model>),
}

impl Opened {
    /// Of at most this many bytes.
    pub fn new(most: u64) -> Self {
        Self { most, bytes: 0, uses: 0, items: BTreeMap::new() }
    }

    /// The call with its arguments.
    ///
    /// # Errors
    /// An argument is not what the call takes it for.
    pub fn ready(&mut self, files: &mut Files, call: Call) -> Result<Ready, CallError> {
        match call {
            Call::Dose { engine, gantry_deg, couch_deg } => {
                let found = self.item(files, &engine, |file| {
                    DoseEngine::from_bytes(file.bytes())
                        .map(|e| Item::Engine(Arc::new(e)))
                        .map_err(CallError::of)
                })?;
                let Item::Engine(engine) = found else { return Err(CallError::Argument(engine)) };
                Ok(Ready::Dose { engine, angles: BeamAngles { gantry_deg, couch_deg } })
            }
            Call::Solve { goals, beams, start, tolerance } => {
                let beams = self.doses(files, &beams)?;
                let bixels: usize = beams.iter().map(|setups| setups[0].dose().columns).sum();
                if start.as_ref().is_some_and(|start| start.len() != bixels) {
                    return Err(CallError::Weights(bixels));
                }
                Ok(Ready::Solve { goals: self.goals(files, &goals, &beams)?, beams, start, tolerance })
            }
            Call::Price { goals, base, candidates } => {
                let candidates = self.doses(files, &candidates)?;
                let goals = self.goals(files, &goals, &candidates)?;
                let voxels = goals.voxels().len();
                let plan = |file: MappedFile| {
                    let plan = answer::plan(file.bytes(), None, voxels).map_err(CallError::of)?;
                    Ok(Item::Plan(Arc::new(plan)))
                };
                let base = match base {
                    None => None,
                    Some(hash) => match self.item(files, &hash, plan)? {
                        Item::Plan(plan) if plan.pull.len() == voxels => Some(plan),
                        _ => return Err(CallError::Argument(hash)),
                    },
                };
                Ok(Ready::Price { goals, base, candidates })
            }
            Call::Game { network, case: case_hash, patient, seed, rules } => {
                let network = network.map(|hash| self.network(files, &hash)).transpose()?;
                // A case is used once or twice, and is ten times larger than its file: it is not kept.
                let case = |hash: Hash| {
                    case::from_bytes(files.take(&hash)?.bytes()).map(Box::new).map_err(CallError::of)
                };
                Ok(Ready::Game { network, case: case_hash.map(case).transpose()?, patient, seed, rules })
            }
        }
    }

    fn network(&mut self, files: &mut Files, hash: &Hash) -> Result<Arc<Model>, CallError> {
        let found = self.item(files, hash, |file| {
            let model = Model::from_safetensors(file.bytes()).map_err(CallError::of)?;
            Ok(Item::Network(Arc::new(model)))
        })?;
        let Item::Network(model) = found else { return Err(CallError::Argument(*hash)) };
        Ok(model)
    }

    fn doses(
        &mut self,
        files: &mut Files,
        beams: &[BeamDoses],
    ) -> Result<Vec<Vec<Arc<BeamFile>>>, CallError> {
        let mut of = |hash: &Hash| {
            let found = self.item(files, hash, |file| {
                BeamFile::of_mapped(file).map(|f| Item::Dose(Arc::new(f))).map_err(CallError::of)
            })?;
            let Item::Dose(dose) = found else { return Err(CallError::Argument(*hash)) };
            Ok(dose)
        };
        beams.iter().map(|setups| setups.iter().map(&mut of).collect()).collect()
    }

    /// The goals, for the rows of these doses.
    fn goals(
        &mut self,
        files: &mut Files,
        hash: &Hash,
        beams: &[Vec<Arc<BeamFile>>],
    ) -> Result<Arc<Goals>, CallError> {
        let rows = beams.first().map_or(0, |setups| setups.iter().map(|dose| dose.dose().rows()).sum());
        let found =
            self.item(files, hash, |file| Ok(Item::Goals(Arc::new(goals::from_bytes(file.bytes(), rows)?))))?;
        match found {
            Item::Goals(goals) if goals.rows() == rows => Ok(goals),
            _ => Err(CallError::Argument(*hash)),
        }
    }

    fn item(
        &mut self,
        files: &mut Files,
        hash: &Hash,
        open: impl FnOnce(MappedFile) -> Result<Item, CallError>,
    ) -> Result<Item, CallError> {
        self.uses += 1;
        let used = self.uses;
        if let Some((last, _, item)) = self.items.get_mut(hash) {
            *last = used;
            return Ok(item.clone());
        }
        let file = files.take(hash)?;
        let size = file.bytes().len() as u64;
        let item = open(file)?;
        self.bytes += size;
        self.items.insert(*hash, (used, size, item.clone()));
        while self.bytes > self.most && self.items.len() > 1 {
            let Some(oldest) = self.items.iter().min_by_key(|(_, (used, ..))| *used).map(|(hash, _)| *hash)
            else {
                break;
            };
            if let Some((_, size, _)) = self.items.remove(&oldest) {
                self.bytes -= size;
            }
        }
        Ok(item)
    }
}
