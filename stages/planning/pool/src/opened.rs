//! Arguments of calls, opened and checked, of bounded size.

use std::collections::BTreeMap;
use std::sync::Arc;

use stillpoint_network::Model;
use stillpoint_patient::case;
use stillpoint_plan::dose::{BeamAngles, BeamFile, DoseEngine};
use stillpoint_plan::fluence::{Goals, Plan};

use crate::call::BeamDoses;
use crate::{Call, CallError, Hash, Ready, Store, answer, goals};

/// Arguments that calls share, so that each is read once. The one used longest ago goes first.
pub struct Opened {
    most: u64,
    bytes: u64,
    uses: u64,
    items: BTreeMap<Hash, (u64, u64, Item)>,
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
    pub fn ready(&mut self, store: &mut Store, call: Call) -> Result<Ready, CallError> {
        match call {
            Call::Dose { engine, gantry_deg, couch_deg } => {
                let found = self.item(store, &engine, |bytes, _| {
                    DoseEngine::from_bytes(bytes).map(|e| Item::Engine(Arc::new(e))).map_err(CallError::of)
                })?;
                let Item::Engine(engine) = found else { return Err(CallError::Argument(engine)) };
                Ok(Ready::Dose { engine, angles: BeamAngles { gantry_deg, couch_deg } })
            }
            Call::Solve { goals, beams, start, tolerance } => {
                let beams = self.doses(store, &beams)?;
                let bixels: usize = beams.iter().map(|setups| setups[0].dose().columns).sum();
                if start.as_ref().is_some_and(|start| start.len() != bixels) {
                    return Err(CallError::Weights(bixels));
                }
                Ok(Ready::Solve { goals: self.goals(store, &goals, &beams)?, beams, start, tolerance })
            }
            Call::Price { goals, base, candidates } => {
                let candidates = self.doses(store, &candidates)?;
                let goals = self.goals(store, &goals, &candidates)?;
                let voxels = goals.voxels().len();
                let plan = |bytes: &[u8], _: &Store| {
                    let plan = answer::plan(bytes, None, voxels).map_err(CallError::of)?;
                    Ok(Item::Plan(Arc::new(plan)))
                };
                let base = match base {
                    None => None,
                    Some(hash) => match self.item(store, &hash, plan)? {
                        Item::Plan(plan) if plan.pull.len() == voxels => Some(plan),
                        _ => return Err(CallError::Argument(hash)),
                    },
                };
                Ok(Ready::Price { goals, base, candidates })
            }
            Call::Game { network, case: case_hash, patient, seed, rules } => {
                let network = network.map(|hash| self.network(store, &hash)).transpose()?;
                // A case is used once or twice, and is ten times larger than its file: it is not kept.
                let case = |hash: Hash| {
                    case::from_bytes(store.read(&hash)?.bytes()).map(Box::new).map_err(CallError::of)
                };
                Ok(Ready::Game { network, case: case_hash.map(case).transpose()?, patient, seed, rules })
            }
        }
    }

    fn network(&mut self, store: &mut Store, hash: &Hash) -> Result<Arc<Model>, CallError> {
        let found = self.item(store, hash, |bytes, _| {
            let model = Model::from_safetensors(bytes).map_err(CallError::of)?;
            Ok(Item::Network(Arc::new(model)))
        })?;
        let Item::Network(model) = found else { return Err(CallError::Argument(*hash)) };
        Ok(model)
    }

    fn doses(
        &mut self,
        store: &mut Store,
        beams: &[BeamDoses],
    ) -> Result<Vec<Vec<Arc<BeamFile>>>, CallError> {
        let mut of = |hash: &Hash| {
            let found = self.item(store, hash, |_, store| {
                BeamFile::open_any(&store.path(hash)).map(|f| Item::Dose(Arc::new(f))).map_err(CallError::of)
            })?;
            let Item::Dose(dose) = found else { return Err(CallError::Argument(*hash)) };
            Ok(dose)
        };
        beams.iter().map(|setups| setups.iter().map(&mut of).collect()).collect()
    }

    /// The goals, for the rows of these doses.
    fn goals(
        &mut self,
        store: &mut Store,
        hash: &Hash,
        beams: &[Vec<Arc<BeamFile>>],
    ) -> Result<Arc<Goals>, CallError> {
        let rows = beams.first().map_or(0, |setups| setups.iter().map(|dose| dose.dose().rows()).sum());
        let found =
            self.item(store, hash, |bytes, _| Ok(Item::Goals(Arc::new(goals::from_bytes(bytes, rows)?))))?;
        match found {
            Item::Goals(goals) if goals.rows() == rows => Ok(goals),
            _ => Err(CallError::Argument(*hash)),
        }
    }

    fn item(
        &mut self,
        store: &mut Store,
        hash: &Hash,
        open: impl FnOnce(&[u8], &Store) -> Result<Item, CallError>,
    ) -> Result<Item, CallError> {
        self.uses += 1;
        let used = self.uses;
        if let Some((last, _, item)) = self.items.get_mut(hash) {
            *last = used;
            return Ok(item.clone());
        }
        let file = store.read(hash)?;
        let size = file.bytes().len() as u64;
        let item = open(file.bytes(), store)?;
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
