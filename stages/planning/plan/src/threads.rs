//! The same work on each of many items, over threads.

use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread;

/// Does the same to each item, on several threads; results are in the items' order, whatever the number of threads. Of
/// several errors it gives that of the first item.
pub fn on_threads<I: Sync, T: Send, E: Send>(
    items: &[I],
    threads: NonZeroUsize,
    work: impl Fn(&I) -> Result<T, E> + Sync,
) -> Result<Vec<T>, E> {
    if threads.get() == 1 || items.len() <= 1 {
        return items.iter().map(work).collect();
    }
    let next = AtomicUsize::new(0);
    let take = || {
        let mut done = Vec::new();
        loop {
            let i = next.fetch_add(1, Ordering::Relaxed);
            let Some(item) = items.get(i) else { return done };
            done.push((i, work(item)));
        }
    };
    let mut done = thread::scope(|scope| {
        let others: Vec<_> = (1..threads.get().min(items.len())).map(|_| scope.spawn(take)).collect();
        let mut done = take();
        for other in others {
            done.extend(other.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)));
        }
        done
    });
    done.sort_by_key(|(i, _)| *i);
    done.into_iter().map(|(_, result)| result).collect()
}

/// Does the same with each item, on several threads: for parts of one array, which each item owns.
pub fn with_each<I: Send>(items: Vec<I>, threads: NonZeroUsize, work: impl Fn(I) + Sync) {
    if threads.get() == 1 || items.len() <= 1 {
        return items.into_iter().for_each(work);
    }
    let others = threads.get().min(items.len()) - 1;
    let left = Mutex::new(items.into_iter());
    let take = || {
        loop {
            let item = left.lock().unwrap_or_else(PoisonError::into_inner).next();
            let Some(item) = item else { return };
            work(item);
        }
    };
    thread::scope(|scope| {
        (0..others).for_each(|_| drop(scope.spawn(take)));
        take();
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_in_the_order_of_the_items_and_the_first_error_wins() {
        let items: Vec<usize> = (0..20).collect();
        for threads in [1, 2, 3, 20, 99].map(|n| NonZeroUsize::new(n).unwrap()) {
            assert_eq!(on_threads(&items, threads, |&i| Ok::<_, ()>(i)), Ok(items.clone()));
            assert_eq!(on_threads(&items, threads, |&i| if i < 9 { Ok(i) } else { Err(i) }), Err(9));
        }
        assert_eq!(on_threads(&[], NonZeroUsize::MIN, |&i: &usize| Ok::<_, ()>(i)), Ok(vec![]));
    }
}
