use super::*;
use std::io::Read;
use std::process::Command;

#[test]
fn a_place_that_takes_no_file_is_told_with_what_to_name_instead() {
    let folder = tempfile::tempdir().unwrap();
    let refused = Disk::start(RecordingPlace {
        first: folder.path().join("none/run.mcap"),
        keep_bytes: 1 << 30,
        owns_folder: false,
    });
    let refused = refused.err().unwrap().to_string();
    for says in ["none/run.mcap cannot be written", "--record FILE"] {
        assert!(refused.contains(says), "{refused}");
    }
}

/// As of two controllers whose scene names the file.
#[test]
fn a_file_that_another_run_writes_is_refused_and_keeps_its_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let first = folder.path().join("run.mcap");
    let place = || RecordingPlace {
        first: first.clone(),
        keep_bytes: 1 << 30,
        owns_folder: false,
    };
    let disk = Disk::start(place()).unwrap();
    assert!(disk.write(vec![1; 10], 0));
    // Also once it is whole.
    assert!(disk.begin(1, 1) && disk.write(vec![1; 10], 1));
    disk.wait(Duration::from_secs(10));
    let refused = Disk::start(place()).err().unwrap().to_string();
    assert!(refused.contains("another run is writing it"), "{refused}");
    assert_eq!(disk.finish(), Some(vec![first.clone(), place().path(1)]));
    assert_eq!(std::fs::read(&first).unwrap(), [1; 10]);
    // After its end the file is begun anew.
    let next = Disk::start(place()).unwrap();
    assert!(next.write(vec![2; 3], 0));
    assert_eq!(next.finish(), Some(vec![first.clone()]));
    assert_eq!(std::fs::read(&first).unwrap(), [2; 3]);
}

#[test]
fn files_of_a_scene_longer_than_the_queue_wait_behind_other_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let first = folder.path().join("run.mcap");
    // Whoever writes into a pipe waits for its reader.
    let made = Command::new("mkfifo").arg(&first).status();
    assert!(made.unwrap().success());
    let (release, released) = sync_channel::<()>(0);
    let pipe = first.clone();
    let reader = std::thread::spawn(move || {
        let mut file = File::open(pipe).unwrap();
        let _ = released.recv();
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).unwrap();
        bytes.len()
    });
    let disk = Disk::start(RecordingPlace {
        first: first.clone(),
        keep_bytes: 1 << 30,
        owns_folder: false,
    });
    let disk = disk.unwrap();
    // More than the pipe holds, so it stays in the queue.
    let (frame, files) = (1 << 20, RECORDING_QUEUE_BYTES + 1);
    assert!(disk.write(vec![0; frame], 0));
    assert!(disk.write(vec![0; files], 1));
    assert!(!disk.write(vec![0], 2), "the queue is full");
    disk.wait(Duration::from_millis(2));
    assert!(!disk.is_idle(), "nobody has read");
    // Not for what is enough already.
    let hour = Duration::from_secs(3600);
    disk.wait_until(|queued| queued > files, Instant::now() + hour);
    drop(release);
    assert_eq!(disk.finish(), Some(vec![first]));
    assert_eq!(reader.join().unwrap(), frame + files);
}

/// A file that takes no more bytes tells from which tick on, though later ones waited already.
#[test]
fn what_waited_behind_a_failure_is_lost_with_it() {
    let folder = tempfile::tempdir().unwrap();
    let first = folder.path().join("run.mcap");
    let made = Command::new("mkfifo").arg(&first).status();
    assert!(made.unwrap().success());
    let frame = 1 << 20;
    let pipe = first.clone();
    let (release, released) = std::sync::mpsc::channel::<()>();
    // It reads one frame once all wait, and closes the pipe before the next.
    let reader = std::thread::spawn(move || {
        let mut bytes = vec![0; frame];
        let mut pipe = File::open(pipe).unwrap();
        let _ = released.recv();
        pipe.read_exact(&mut bytes).unwrap();
    });
    let place = RecordingPlace {
        first,
        keep_bytes: 1 << 30,
        owns_folder: false,
    };
    let second = place.path(1);
    let disk = Disk::start(place).unwrap();
    assert!(!disk.has_lost());
    for tick in [0, 100, 200, 300] {
        assert!(disk.write(vec![0; frame], tick));
    }
    drop(release);
    reader.join().unwrap();
    disk.wait(Duration::from_secs(10));
    assert!(disk.failure().is_some());
    assert!(disk.has_lost());
    assert_eq!(disk.take_lost(), Some(100));
    assert_eq!(disk.take_lost(), None);
    // Another file takes bytes before the thread has begun it.
    assert!(disk.begin(1, 400) && disk.write(vec![0; frame], 400));
    assert_eq!(disk.finish().unwrap().last(), Some(&second));
}

#[test]
fn only_a_lock_of_another_one_holds_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let held = File::create(&path).unwrap();
    held.lock_shared().unwrap();
    assert!(is_held(&File::open(&path).unwrap().try_lock()));
    drop(held);
    assert!(!is_held(&File::open(&path).unwrap().try_lock()));
    let no_locks = io::Error::from(io::ErrorKind::Unsupported);
    assert!(!is_held(&Err(TryLockError::Error(no_locks))));
    // No answer about the lock is no leave to remove it.
    for (number, held) in [(ENOLCK, false), (9, true)] {
        let error = io::Error::from_raw_os_error(number);
        assert_eq!(is_held(&Err(TryLockError::Error(error))), held, "{number}");
    }
}

/// In a folder of hrtc's own the files of earlier runs go first, then the oldest of this one,
/// and no more than that.
#[test]
fn in_its_own_folder_a_run_keeps_as_many_of_its_files_as_it_may() {
    let folder = tempfile::tempdir().unwrap();
    let earlier = folder.path().join("earlier.mcap");
    let keep_bytes = 64 << 10;
    let place = RecordingPlace {
        first: folder.path().join("run.mcap"),
        keep_bytes,
        owns_folder: true,
    };
    let bytes = place.file_bytes();
    std::fs::write(&earlier, vec![0; bytes as usize]).unwrap();
    let disk = Disk::start(place.clone()).unwrap();
    let most = keep_bytes / bytes;
    for number in 0..8 {
        assert!(number == 0 || disk.begin(number, 0));
        assert!(disk.write(vec![0; bytes as usize], 0));
        disk.wait(Duration::from_secs(10));
        let is_there = |of: &u32| place.path(*of).exists();
        let kept: Vec<u32> = (0..=number).filter(is_there).collect();
        let oldest = (u64::from(number) + 1).saturating_sub(most) as u32;
        assert_eq!(kept, (oldest..=number).collect::<Vec<_>>(), "file {number}");
        assert_eq!(
            earlier.exists(),
            u64::from(number) + 1 < most,
            "file {number}"
        );
    }
    let kept = disk.finish().unwrap();
    assert_eq!(kept, [4, 5, 6, 7].map(|number| place.path(number)));
}
