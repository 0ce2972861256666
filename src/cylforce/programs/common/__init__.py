"""What several commands share: reading machine and recordings, playing, progress, scores. No command stands here."""
