//! No other cut is cheaper.

use super::{Lean, MinCut};
use proptest::prelude::*;

fn any_lean() -> impl Strategy<Value = Lean> {
    prop_oneof![1 => Just(Lean::Source), 1 => Just(Lean::Sink), 6 => (-20..20_i32).prop_map(Lean::Cost)]
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_other_cut_is_cheaper(
        leans in prop::collection::vec(any_lean(), 1..9),
        edges in prop::collection::vec((0..9_u32, 0..9_u32, 0..20_u32), 0..20),
    ) {
        let nodes = leans.len() as u32;
        let edges: Vec<_> = edges.into_iter().filter(|&(a, b, _)| a != b && a < nodes && b < nodes).collect();
        let cost = |with_source: &dyn Fn(u32) -> bool| -> u64 {
            let leaning = (0..nodes).map(|n| match (with_source(n), leans[n as usize]) {
                (false, Lean::Source) | (true, Lean::Sink) => 1_000_000,
                (false, Lean::Cost(lean)) if lean > 0 => lean as u64,
                (true, Lean::Cost(lean)) if lean < 0 => -lean as u64,
                _ => 0,
            });
            let parted = edges.iter().filter(|&&(a, b, _)| with_source(a) != with_source(b));
            leaning.sum::<u64>() + parted.map(|e| u64::from(e.2)).sum::<u64>()
        };
        let mut graph = MinCut::default();
        // A graph of before leaves nothing.
        graph.start(3);
        graph.lean(0, Lean::Cost(9));
        graph.lean(1, Lean::Cost(-9));
        graph.lean(2, Lean::Sink);
        graph.join(0, 1, || 7);
        graph.join(2, 1, || 7);
        graph.cut();
        graph.start(nodes as usize);
        for (node, &lean) in leans.iter().enumerate() {
            graph.lean(node as u32, lean);
        }
        for &(a, b, capacity) in &edges {
            graph.join(a, b, || capacity);
        }
        let found = graph.cut();
        let least = (0..1_u32 << nodes).map(|set| cost(&|n| set >> n & 1 == 1)).min().unwrap();
        prop_assert_eq!(found, least);
        prop_assert_eq!(cost(&|n| graph.with_source(n)), least);
    }
}
