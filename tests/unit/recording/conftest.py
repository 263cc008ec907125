from tests.harness.two_sessions import cache_folder, folder, sessions

__all__ = ["cache_folder", "folder", "sessions"]
