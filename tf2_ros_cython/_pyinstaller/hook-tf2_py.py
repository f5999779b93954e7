# All our packages import tf2_py.
from tf2_ros_cython._pyinstaller import hidden_imports

hiddenimports = hidden_imports()
