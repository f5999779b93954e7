"""The benchmark: what this project costs beside other libraries, measured in one run (`python -m bench`)."""
