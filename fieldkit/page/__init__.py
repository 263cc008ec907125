"""The field page: a browser shows, draws, starts and marks; a server between it and the recorder."""
